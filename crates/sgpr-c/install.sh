#!/bin/sh
# Installs the C library: install.sh FOLDER PREFIX
#
# FOLDER holds libsgpr.so and libsgpr.a, as target/release after `cargo build --release --package sgpr-c`. Below PREFIX come
# headers, both libraries, a file for pkg-config and a package for CMake; they find each other wherever PREFIX is moved to.
# DESTDIR is put before PREFIX, for those who make packages.
set -eu

if [ $# -ne 2 ]; then
    echo "usage: install.sh FOLDER PREFIX" >&2
    exit 2
fi
from=$1
to=${DESTDIR:-}$2
here=$(cd "$(dirname "$0")" && pwd)
for name in libsgpr.so libsgpr.a; do
    if [ ! -f "$from/$name" ]; then
        echo "$from/$name is not there: cargo build --release --package sgpr-c" >&2
        exit 1
    fi
done
abi=$(sed -n 's/^#define SGPR_ABI_VERSION \([0-9]*\).*/\1/p' "$here/include/sgpr.h")
version=$(sed -n '/^\[workspace.package\]/,/^\[/s/^version = "\(.*\)"/\1/p' "$here/../../Cargo.toml")

mkdir -p "$to/include" "$to/lib/pkgconfig" "$to/lib/cmake/sgpr"
install -m 644 "$here/include/sgpr.h" "$here/include/sgpr.hpp" "$to/include"
install -m 755 "$from/libsgpr.so" "$to/lib/libsgpr.so.$abi"
ln -sf "libsgpr.so.$abi" "$to/lib/libsgpr.so"
install -m 644 "$from/libsgpr.a" "$to/lib"
# What is written must be whole: beside, then renamed.
fill() {
    sed -e "s/@VERSION@/$version/g" -e "s/@ABI@/$abi/g" "$here/package/$1.in" > "$2/.$1.part"
    mv "$2/.$1.part" "$2/$1"
}
fill sgpr.pc "$to/lib/pkgconfig"
fill sgpr-config.cmake "$to/lib/cmake/sgpr"
fill sgpr-config-version.cmake "$to/lib/cmake/sgpr"
