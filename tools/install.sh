#!/bin/bash
# Makes .venv with everything that Softprint needs on a fresh Debian 12 or 13; fast if everything is installed.
#
#   tools/install.sh [--check]        --check: only report whether anything is missing (exit status 1 if so)
#   tools/install.sh --docs           only what builds the documentation, in an environment of its own, .venv.docs
#   tools/install.sh --for-tests      both, at once; the kernels of simulations are compiled by the tests, whose two
#                                     workers share them
#
# Debian packages first (with sudo if not root), then pinned wheels:
#   * DOLFINx, PETSc, MPI and packages that depend on numpy are Debian's: their versions must match.
#   * h5py is Debian's too. PyPI's wheel contains its own HDF5, and crashes if DOLFINx was imported first.
#     So nothing here may install h5py's wheel: Softprint itself is installed with --no-deps.
#   * torch is a pinned wheel on Debian 12, whose package is too old. On Debian 13 it is Debian's. The wheel may install
#     several GB of CUDA; an index of CPU builds in PIP_INDEX_URL or PIP_EXTRA_INDEX_URL avoids that.
#   * libopenblas0-serial, because Debian's reference BLAS makes factorisations some seven times slower, and because
#     each MPI rank needs one thread.
set -euo pipefail
cd "$(dirname "$0")/.."

SYSTEM_PYTHON=/usr/bin/python3
VENV=.venv
APT_PACKAGES=(
    python3-dolfinx python3-petsc4py python3-mpi4py openmpi-bin python3-venv python3-dev python3-pip
    python3-h5py python3-scipy gcc libc6-dev make libopenblas0-serial
    chromium # in which the window is tested
    libgl1 libegl1 libglu1-mesa libxrender1 libxcursor1 libxft2 libxinerama1 libxi6 libxfixes3 libxext6 libsm6
)

say() { printf '%s\n' "$*" >&2; }
die() { say "$*"; exit 1; }

release() {
    # ID and VERSION_ID of this system, as "debian12".
    [ -r /etc/os-release ] || die "tools/install.sh: there is no /etc/os-release; it knows Debian 12 and Debian 13."
    (. /etc/os-release && printf '%s%s' "${ID:-unknown}" "${VERSION_ID:-}")
}

RELEASE="$(release)"
CONSTRAINTS="constraints/$RELEASE.txt"
case "$RELEASE" in
    debian12) ;;
    debian13) APT_PACKAGES+=(python3-torch) ;;
    *) die "tools/install.sh knows Debian 12 and Debian 13, and this is $RELEASE." \
           "Elsewhere: install DOLFINx your own way, then pip install '.[truth,report,dev]' into its environment." ;;
esac

wheels_fingerprint() {
    # The sources and location of the wheels in .venv: a moved .venv does not work.
    { pwd; "$SYSTEM_PYTHON" --version; printf '%s ' "${APT_PACKAGES[@]}"; cat "$CONSTRAINTS"; } | sha256sum
}

project_fingerprint() {
    { wheels_fingerprint; cat pyproject.toml; } | sha256sum
}

has() {
    # has STAMP FINGERPRINT: whether that part of .venv was finished from the current sources.
    [ "$(cat "$VENV/$1" 2>/dev/null)" = "$2" ]
}

is_complete() {
    [ -x "$SYSTEM_PYTHON" ] && [ -x "$VENV/bin/softprint" ] && has installed "$(project_fingerprint)" &&
        { [ -n "$for_tests" ] || has kernels "$(project_fingerprint)"; }
}

as_root() {
    if [ "$(id -u)" = 0 ]; then
        "$@"
    elif command -v sudo >/dev/null; then
        sudo -- "$@"
    else
        die "Packages are missing, and neither are you root nor is there sudo. As root: apt-get install ${MISSING[*]}"
    fi
}

install_debian_packages() {
    MISSING=()
    local package
    for package in "${APT_PACKAGES[@]}"; do
        [ "$(dpkg-query -W -f='${db:Status-Status}' "$package" 2>/dev/null)" = installed ] || MISSING+=("$package")
    done
    [ ${#MISSING[@]} -eq 0 ] && return
    say "Installing Debian packages: ${MISSING[*]}"
    as_root env DEBIAN_FRONTEND=noninteractive dpkg --configure -a # finish an interrupted installation
    as_root env DEBIAN_FRONTEND=noninteractive apt-get update -q
    as_root env DEBIAN_FRONTEND=noninteractive apt-get install -q -y --no-install-recommends "${MISSING[@]}"
}

PIP=("$VENV/bin/python" -m pip install --quiet --disable-pip-version-check --no-input)

install_wheels() {
    has wheels "$(wheels_fingerprint)" && return
    say "Installing Python packages into $VENV"
    # --clear: do not build on an incomplete environment, or one of another Python.
    "$SYSTEM_PYTHON" -m venv --clear --system-site-packages "$VENV"
    # Without dependencies: the list is complete, and no wheel may install a package that Debian provides.
    grep -v '^torch==' "$CONSTRAINTS" > "$VENV/wheels.txt"
    "${PIP[@]}" --no-deps -r "$VENV/wheels.txt"
    # torch with its dependencies, which differ between its builds for CPU and for CUDA.
    if grep -q '^torch==' "$CONSTRAINTS"; then
        "${PIP[@]}" -c "$CONSTRAINTS" torch
    fi
    wheels_fingerprint > "$VENV/wheels"
}

install_softprint() {
    has installed "$(project_fingerprint)" && return
    "${PIP[@]}" --no-deps --no-build-isolation --editable .
    project_fingerprint > "$VENV/installed"
}

compile_kernels() {
    say "Compiling the kernels of simulations"
    "$VENV/bin/softprint" warm-up >&2
    project_fingerprint > "$VENV/kernels"
}

install_docs() {
    # In an environment of its own: what builds the documentation changes the output of programs that use numba.
    local docs_venv=.venv.docs stamp
    stamp="$(cat constraints/docs.txt; pwd)"
    [ "$(cat "$docs_venv/installed" 2>/dev/null)" = "$stamp" ] && return
    say "Installing what builds the documentation into $docs_venv"
    "$SYSTEM_PYTHON" -m venv --clear "$docs_venv"
    "$docs_venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-input -r constraints/docs.txt
    printf '%s' "$stamp" > "$docs_venv/installed"
}

if [ "${1:-}" = --docs ]; then
    install_docs
    exit 0
fi
for_tests=
[ "${1:-}" = --for-tests ] && for_tests=1
finished() {
    is_complete || return 0
    [ -z "$for_tests" ] || install_docs
    exit 0
}
finished
[ "${1:-}" = --check ] && exit 1
exec {lock}> .venv.lock
flock "$lock" # two concurrent installations would corrupt .venv
finished
install_debian_packages
[ -z "$for_tests" ] || { install_docs & docs=$!; }
install_wheels
install_softprint
[ -n "$for_tests" ] || compile_kernels
[ -z "$for_tests" ] || wait "$docs"
say "Installed. Try: $VENV/bin/softprint doctor"
