"""Writes the NumPy, MATLAB and HDF5 fixtures of the recording tests with packages that are not ours.

    pip install numpy scipy h5py
    python make_arrays.py

All of them hold what is in `log.csv`, or in `coarse.csv`, whose numbers fit 16 bits.
"""

import struct
from pathlib import Path

import h5py
import numpy as np
import scipy.io
import scipy.sparse

HERE = Path(__file__).parent
NAMES = ["shoulder", "elbow_2"]
SAMPLES = 30
K = np.arange(SAMPLES)
LOG = {
    "t": K / 100,
    "q": np.sin(np.stack([K / 7, 1 + K / 9], axis=1)),
    "dq": np.cos(np.stack([K / 7, 1 + K / 9], axis=1)),
    "tau": 10 / np.stack([K + 3, 2 * K + 7], axis=1),
}
# Multiples of 1/64 below 16 are exact in 16 bits.
COARSE = {"t": K / 8, **{name: np.round(64 * LOG[name]) / 64 for name in ("q", "dq", "tau")}}
MATLAB_HEADER = b"MATLAB 5.0 MAT-file, made by make_arrays.py"


def table(name, log):
    """Numbers as Python prints them, which is exact."""
    columns = [log["t"], *(log[quantity][:, k] for quantity in ("q", "dq", "tau") for k in range(2))]
    rows = [",".join(repr(float(value)) for value in row) for row in zip(*columns, strict=True)]
    (HERE / name).write_text("\n".join(["t,q_1,q_2,dq_1,dq_2,tau_1,tau_2", *rows]) + "\n")


def numpy_archives():
    np.savez(HERE / "stored.npz", **LOG, joint_names=np.array(NAMES))
    np.savez_compressed(HERE / "packed.npz", **LOG, joint_names=np.array(NAMES))
    turned = {name: np.asfortranarray(values.astype(">f8")) for name, values in LOG.items()}
    np.savez_compressed(HERE / "fortran.npz", **turned, extra=K[:, None, None] * np.ones((1, 2, 3), order="F"))
    narrow = {"q": COARSE["q"].astype("f4"), "dq": COARSE["dq"].astype(">f2"), "tau": COARSE["tau"].astype("f2")}
    np.savez_compressed(HERE / "narrow.npz", time_ns=K * 125_000_000, **narrow)
    dates = np.datetime64(0, "ns") + (K * 125).astype("m8[ms]")
    np.savez_compressed(HERE / "dates.npz", **{**COARSE, "t": dates})


def matlab(name, content, **options):
    scipy.io.savemat(HERE / name, content, **options)
    if options.get("format") != "4":
        # SciPy writes the date.
        with (HERE / name).open("r+b") as file:
            file.write(MATLAB_HEADER.ljust(116))


def element(order, kind, data):
    return struct.pack(f"{order}II", kind, len(data)) + data + bytes(-len(data) % 8)


def variable(order, name, of_class, shape, kind, data, flags=0):
    head = element(order, 6, struct.pack(f"{order}II", of_class | flags, 0))
    head += element(order, 5, struct.pack(f"{order}{len(shape)}i", *shape))
    return element(order, 14, head + element(order, 1, name) + element(order, kind, data))


def matlab_object(name, of_class):
    """As MATLAB writes what only it understands."""
    body = element("<", 6, struct.pack("<II", 17, 0)) + element("<", 1, name) + element("<", 1, b"MCOS")
    body += element("<", 1, of_class) + variable("<", b"", 13, (6, 1), 6, bytes(24))
    return element("<", 14, body)


def matlab_files():
    cell = np.array(NAMES, dtype=object)
    matlab("version_4.mat", {**LOG, "joint_names": np.array(NAMES)}, format="4")
    matlab("plain.mat", {**LOG, "t": LOG["t"][:, None], "joint_names": cell})
    matlab("packed.mat", {**LOG, "joint_names": np.array(NAMES)}, do_compression=True)
    settings = {"gains": np.ones(4), "names": {"t": 1.0}, "rates": np.array([1 + 2j, 3, 4])}
    run = {"time": LOG["t"], "q": LOG["q"].T, "dq": LOG["dq"].T, "tau": LOG["tau"].T, "joint_names": cell}
    beside = {"para": settings, "empty": [], "some": np.array([1.0, "a"], dtype=object), "map": scipy.sparse.eye(30)}
    matlab("structure.mat", {"rec": run, **beside}, do_compression=True)
    with (HERE / "structure.mat").open("ab") as file:
        file.write(matlab_object(b"rec2", b"timeseries"))
    # A machine of the other byte order; MATLAB packs whole numbers as such, whatever their class.
    order, header = ">", MATLAB_HEADER.ljust(124) + b"\x01\x00MI"
    parts = [variable(order, b"t", 6, (1, SAMPLES), 2, K.astype("u1").tobytes())]
    for name in ("q", "dq", "tau"):
        data = COARSE[name].T.astype(">f4").tobytes()
        parts.append(variable(order, name.encode(), 7, (SAMPLES, 2), 7, data))
    (HERE / "big_endian.mat").write_bytes(header + b"".join(parts))


def hdf5_files():
    def fill(file, log, **options):
        for name, values in log.items():
            file.create_dataset(name, data=values, **options)

    for version in ("earliest", "latest"):
        with h5py.File(HERE / f"{version}.h5", "w", libver=version) as file:
            fill(file.create_group("run_1"), LOG)
            file["run_1/joint_names"] = NAMES
            file["run_1"].create_dataset("image", data=np.zeros((2, 2)), compression="gzip")
            file["again"] = file["/"]
    with h5py.File(HERE / "packed.h5", "w", libver="latest") as file:
        fill(file, LOG, chunks=True, compression="gzip", shuffle=True, fletcher32=True)
        file["joint_names"] = np.array(NAMES, dtype="S12")
    with h5py.File(HERE / "lzf.h5", "w") as file:
        fill(file, LOG, compression="lzf")
        file.create_dataset("flat", data=np.zeros(2000), compression="lzf")
    with h5py.File(HERE / "narrow.h5", "w", libver="latest") as file:
        fill(file, {"t": COARSE["t"].astype(">f8"), "q": COARSE["q"].astype("f4"), "dq": COARSE["dq"].astype(">f4")})
        file["tau"], file["moving"] = COARSE["tau"].astype("f2"), K > 3
        file["record"] = np.zeros(SAMPLES, dtype=[("a", "f8"), ("b", "i4")])
        # Its chunks are numbered over the largest shape, which readers may miss.
        file.create_dataset("grown", data=np.ones((8, 8)), chunks=(2, 2), maxshape=(16, 32))
        file["torn"] = h5py.ExternalLink("another.h5", "/x")
        file["loose"] = h5py.SoftLink("/nothing")
    with h5py.File(HERE / "units.h5", "w") as file:
        file["arm/time"], file["arm/position"], file["arm/velocity"] = 125.0 * K, COARSE["q"], COARSE["dq"]
        file["arm/effort"] = COARSE["tau"]
        for name, key, unit in (
            ("time", "units", "ms"),
            ("position", "unit", "rad"),
            ("velocity", "units", np.bytes_("rad/s")),
            ("effort", "units", "Nm"),
        ):
            file[f"arm/{name}"].attrs[key] = unit
    with h5py.File(HERE / "version_7_3.mat", "w", userblock_size=512) as file:
        for name, values in LOG.items():
            file[name] = values.T if values.ndim == 2 else values[None, :]
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
        letters = [[ord(letter) for letter in name.ljust(8)] for name in NAMES]
        file["joint_names"] = np.array(letters, dtype="u2").T
        file["joint_names"].attrs["MATLAB_class"] = np.bytes_("char")
        file["none"] = np.zeros(2, dtype="u8")
        file["none"].attrs["MATLAB_class"], file["none"].attrs["MATLAB_empty"] = np.bytes_("double"), np.uint8(1)
        file["#refs#/a"] = LOG["t"]
    with (HERE / "version_7_3.mat").open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, made by make_arrays.py".ljust(124) + b"\x00\x02IM")


if __name__ == "__main__":
    table("log.csv", LOG)
    table("coarse.csv", COARSE)
    numpy_archives()
    matlab_files()
    hdf5_files()
