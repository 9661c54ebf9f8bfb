"""The addresses of the page."""

import json
import os
import struct
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import typer
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from .. import SgprError
from ..cli.errors import BadData
from ..reading import suffixes
from ..report.page import plotly_source
from ..report.signature import VARIABLES
from . import takeaway
from .bench import Bench
from .folder import ROBOT_SUFFIXES
from .guard import Guard
from .residuals import Region, Samples, against, difference, over_two, whiteness
from .tracks import piece

LARGEST_UPLOAD = 1_000_000_000
LARGEST_ORDER = 1_000_000
WRONG = (SgprError, BadData, OSError, ValueError, KeyError, TypeError, typer.BadParameter)

ACTIONS: dict[str, tuple[str, ...]] = {
    "set_robot": ("name",),
    "set_role": ("name", "role"),
    "set_reading": ("name", "settings"),
    "look_again": (),
    "fit": ("effects",),
    "diagnose": (),
    "add": ("effects", "after"),
    "learn": (),
    "take_back": (),
    "use": ("name",),
    "remove": ("name",),
    "rename": ("name", "to"),
    "show": ("name", "shown"),
    "pin": ("name",),
}
"""Methods of the bench that the page may call, and what it gives."""


def application(bench: Bench, token: str, port: int) -> Starlette:
    """The server of a bench."""
    page = resources.files(__package__).joinpath("page")
    routes = [
        Route("/", _page),
        Route("/assets/plotly.js", _plotly),
        Mount("/assets", StaticFiles(directory=str(page))),
        Route("/api/state", _state),
        Route("/api/do/{action}", _do, methods=["POST"]),
        Route("/api/cancel", _cancel, methods=["POST"]),
        Route("/api/upload", _upload, methods=["POST"]),
        Route("/api/series", _series),
        Route("/api/residual", _answered(_residual)),
        Route("/api/whiteness", _answered(_whiteness)),
        Route("/api/signature", _answered(_signature)),
        Route("/api/take/{what}", _take),
    ]
    app = Starlette(routes=routes, middleware=[Middleware(Guard, token=token, port=port)])
    app.state.bench = bench
    return app


async def _page(request: Request) -> Response:
    text = resources.files(__package__).joinpath("page/index.html").read_text(encoding="utf-8")
    return Response(text, media_type="text/html")


async def _plotly(request: Request) -> Response:
    return Response(plotly_source(), media_type="text/javascript", headers={"cache-control": "max-age=86400"})


async def _state(request: Request) -> Response:
    bench: Bench = request.app.state.bench
    bench.shown.set()
    known = request.query_params.get("version")
    if known == str(bench.version):
        return JSONResponse({"version": bench.version, "job": bench.work.state(), "same": True})
    return JSONResponse(await run_in_threadpool(bench.to_dict))


async def _do(request: Request) -> Response:
    bench: Bench = request.app.state.bench
    action = request.path_params["action"]
    if action not in ACTIONS:
        return _wrong(f"there is no action {action}")
    try:
        order = json.loads(await _body(request, LARGEST_ORDER) or b"{}")
        arguments = {key: order[key] for key in ACTIONS[action] if key in order}
        await run_in_threadpool(lambda: getattr(bench, action)(**arguments))
    except WRONG as error:
        return _wrong(_said(error))
    return JSONResponse(await run_in_threadpool(bench.to_dict))


async def _cancel(request: Request) -> Response:
    request.app.state.bench.work.cancel()
    return JSONResponse({})


async def _body(request: Request, limit: int) -> bytes:
    parts, size = [], 0
    async for part in request.stream():
        size += len(part)
        if size > limit:
            raise BadData(f"larger than {limit} bytes")
        parts.append(part)
    return b"".join(parts)


async def _upload(request: Request) -> Response:
    """Puts a file into the folder: beside its place first, so that half of it is never taken for a log."""
    bench: Bench = request.app.state.bench
    name = request.query_params.get("name", "")
    beside: Path | None = None
    try:
        path = _new_file(bench, name)
        beside = path.with_name(f".{os.getpid()}-{path.name}.part")
        size = 0
        with beside.open("xb") as file:
            async for part in request.stream():
                size += len(part)
                if size > LARGEST_UPLOAD:
                    raise BadData(f"{name}: larger than {LARGEST_UPLOAD / 1e9:g} GB; put it into the folder yourself")
                await run_in_threadpool(file.write, part)
        if path.exists():
            raise BadData(f"{name}: there is a file of this name already")
        beside.rename(path)
        await run_in_threadpool(bench.look_again)
    except WRONG as error:
        return _wrong(_said(error))
    finally:
        if beside is not None:
            beside.unlink(missing_ok=True)
    return JSONResponse(await run_in_threadpool(bench.to_dict))


def _new_file(bench: Bench, name: str) -> Path:
    if not name or name != Path(name).name or "\\" in name or name.startswith(".") or not name.isprintable():
        raise BadData(f"{name!r}: no name of a file")
    if not name.lower().endswith((*suffixes(), *ROBOT_SUFFIXES)) or name == bench.folder.file.name:
        raise BadData(f"{name}: neither a log nor a robot; logs end in {', '.join(suffixes())}")
    path = bench.folder.path(name)
    if path.exists():
        raise BadData(f"{name}: there is a file of this name already")
    return path


async def _series(request: Request) -> Response:
    """Lines of the torque plots: length of a head, the head as JSON, the numbers (t as 64, lines as 32 bit)."""
    bench: Bench = request.app.state.bench
    asked = request.query_params
    try:
        steps = [one for one in asked.get("steps", "").split(",") if one]
        start, end = float(asked.get("from", "-inf")), float(asked.get("to", "inf"))
        points = max(10, int(asked.get("points", "1200")))

        def work() -> bytes:
            track = bench.track(asked["log"])
            joints, every = piece(track, steps, asked.get("kind", "torque"), (start, end), points)
            head = {
                "every": every,
                "span": [float(track.t[0]), float(track.t[-1])],
                "joints": [[[name, len(t)] for name, (t, _) in lines.items()] for lines in joints],
            }
            text = json.dumps(head).encode()
            text += b" " * (-(len(text) + 4) % 8)
            lines = [line for each in joints for line in each.values()]
            numbers = [
                np.asarray(row, dtype=kind) for line in lines for row, kind in zip(line, ("<f8", "<f4"), strict=True)
            ]
            body = b"".join(row.tobytes() + b"\0" * (-row.nbytes % 8) for row in numbers)
            return struct.pack("<I", len(text)) + text + body

        return Response(await run_in_threadpool(work), media_type="application/octet-stream")
    except WRONG as error:
        return _wrong(_said(error))


def _answered(work: Callable[[Bench, Any], Any]) -> Callable[[Request], Any]:
    """An address that answers with JSON."""

    async def answer(request: Request) -> Response:
        try:
            return JSONResponse(await run_in_threadpool(work, request.app.state.bench, request.query_params))
        except WRONG as error:
            return _wrong(_said(error))

    return answer


def _samples(bench: Bench, asked: Any) -> Samples:
    which = asked.get("log", "")
    logs = (
        [which] if which in bench.logs else [log.name for log in bench.logs.values() if log.role == (which or "test")]
    )
    if not logs:
        logs = [log.name for log in bench.logs.values() if log.role == "train"]
    step = bench.ladder[asked.get("step") or bench.ladder.current].id
    joints = [] if bench.robot is None else bench.robot.joint_names
    return Samples(bench, logs, asked.get("joint") or (joints[0] if joints else ""), step)


def _residual(bench: Bench, asked: Any) -> dict[str, Any]:
    samples = _samples(bench, asked)
    region = None
    if asked.get("region"):
        variable, *bounds = json.loads(asked["region"])
        x0, x1, y0, y1 = (float(each) for each in bounds)
        region = Region(str(variable), (x0, x1), (y0, y1))
    k = samples.k
    other = asked.get("other", "")
    if other and other not in bench.ladder.steps:
        other = ""
    figures = [
        against(samples, asked.get(key) or usual, asked.get("colour", ""), other, region)
        for key, usual in (("x", f"dq:{k}"), ("x2", "t"))
    ]
    first, second = asked.get("x") or f"dq:{k}", asked.get("x2") or "t"
    # Over time a map is a line: the position tells more.
    figures.append(
        over_two(samples, first, second if second not in ("t", first) else f"{'dq' if first[:2] == 'q:' else 'q'}:{k}")
    )
    found = {"figures": figures, "variables": samples.variables()}
    return found | ({"difference": difference(samples, region)} if region else {})


def _whiteness(bench: Bench, asked: Any) -> dict[str, Any]:
    processing = bench.models.reference().processing
    return {"figures": whiteness(_samples(bench, asked), 1 if processing is None else processing.decimation)}


def _signature(bench: Bench, asked: Any) -> dict[str, Any]:
    samples = _samples(bench, asked)
    kind = VARIABLES.get(asked.get("effect", ""), "dq")
    variable = "t" if kind == "t" else f"{kind}:{samples.k}"
    return {"figures": [against(samples, variable, other=asked.get("other", ""))]}


async def _take(request: Request) -> Response:
    bench: Bench = request.app.state.bench
    what = request.path_params["what"]
    kinds = {
        "model.sgpr": (takeaway.model_file, "application/octet-stream"),
        "report.html": (takeaway.report, "text/html"),
        "commands.sh": (takeaway.commands, "text/plain"),
        "repeat.py": (takeaway.script, "text/x-python"),
        "next_experiment.csv": (takeaway.next_experiment, "text/csv"),
        "model.h": (lambda bench: takeaway.source(bench, "c"), "text/plain"),
        "model.rs": (lambda bench: takeaway.source(bench, "rust"), "text/plain"),
        "robot.urdf": (takeaway.robot_file, "application/xml"),
    }
    if what not in kinds:
        return _wrong(f"there is no {what}")
    make, kind = kinds[what]
    try:
        content = await run_in_threadpool(make, bench)
    except WRONG as error:
        return _wrong(_said(error))
    return Response(content, media_type=kind, headers={"content-disposition": f'attachment; filename="{what}"'})


def _said(error: BaseException) -> str:
    if isinstance(error, KeyError):
        return f"{error.args[0]} is missing"
    return str(getattr(error, "message", None) or error)


def _wrong(text: str) -> Response:
    return JSONResponse({"error": text}, status_code=400)
