#!/usr/bin/env bash
# The one test command, for people and for continuous integration. `./test.sh --help` explains it.
set -euo pipefail

usage() {
    cat <<'TEXT'
Usage: ./test.sh [--long] [--no-install] [STEP...]

Runs every step, or only those named, and ends with a summary. Exit status 1 when a step failed.

  install     as root on Debian or Ubuntu: the tools the tests need; always: a Python environment
              under target/. Without root it says what is missing.
  fmt         rustfmt, check only
  shell       shellcheck over the scripts
  clippy      all targets, warnings are errors
  doc         rustdoc, warnings are errors
  test        cargo test --workspace
  interop     our formats against cantools, python-can and the Python MCAP readers; the plant
              against CommonRoad's vehicle models; the library of gains against cvxpy
  page        the page that a run leaves, in headless Chromium: curves, cursors, keys, phone
  rehearse    the release build, the default scenario in virtual time, its trace read by Python
  kernel      platoon vcan shell: a command in the kernel it boots, user-mode Linux
  socketcan   the tests that need a kernel with CAN, with can-utils beside whole rehearsals: in a
              network namespace of this kernel, else in the kernel that platoon vcan shell boots,
              else each one is listed as left out
  heavy       long sweeps (tests whose names begin with heavy_); only with --long

  --long        run the heavy step too
  --no-install  install nothing; use what is there
TEXT
}

cd "$(dirname "$(realpath "${BASH_SOURCE[0]}")")"
exec </dev/null
# nohup and a shell's "&" have signals ignored, which every child inherits; tests send them and wait.
if [[ -z ${SIGNALS_ARE_DEFAULT:-} ]]; then
    exec env --default-signal=HUP,INT,QUIT SIGNALS_ARE_DEFAULT=1 "$PWD/test.sh" "$@"
fi
# An ordinary user's search path may lack the folders of ip, insmod and modprobe.
PATH=$PATH:/usr/sbin:/sbin
export CARGO_TERM_COLOR=${CARGO_TERM_COLOR:-never} PYTHONDONTWRITEBYTECODE=1
export PIP_DISABLE_PIP_VERSION_CHECK=1

all_steps=(install fmt shell clippy doc test interop page rehearse kernel socketcan heavy)
# Exit status by which a step says that it was left out; the reasons are in $reasons.
readonly left_out_status=77
# Exit status of platoon vcan shell when it has no kernel to boot.
readonly no_kernel_status=3
# How long the tests in a booted kernel may take before they count as hung.
readonly socketcan_limit_s=3600
# What chooses the tests that need a kernel with CAN from those of a test binary.
readonly in_kernel=(--ignored --skip heavy_ --skip vcan_shell::)

# ---------------------------------------------------------------- what the steps use

leave_out() {
    printf '%s\n' "$@" >>"$reasons"
    exit "$left_out_status"
}

is_root() {
    [[ $(id -u) -eq 0 ]]
}

has() {
    command -v "$1" >/dev/null
}

python() {
    "$venv/bin/python" "$@"
}

# Tests, examples and the command, all that the steps use, exactly as the test step builds them: by
# another cargo command the same crates would have other features, and be built again.
build_tests() {
    cargo test --quiet --locked --workspace --no-run "$@"
}

# Path of a built example, built if need be.
example_path() {
    build_tests >&2
    echo "$target/debug/examples/$1"
}

# Debian packages behind the tools that are missing.
missing_packages() {
    has candump || echo can-utils
    has chromium || echo chromium
    has linux.uml || echo user-mode-linux
    has insmod || echo kmod
    has ip || echo iproute2
    has shellcheck || echo shellcheck
    has tshark || echo tshark
    python3 -c 'import ensurepip, venv' 2>/dev/null || echo python3-venv
}

# Installs what apt has of the packages named; the caller looks at what is missing afterwards.
install_packages() {
    local package
    apt-get update
    for package in "$@"; do
        DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends "$package" ||
            echo "test.sh: apt-get could not install $package" >&2
    done
}

# A Python environment with exactly the packages of requirements.txt, made anew when they change.
make_venv() {
    local requirements=tests/interop/requirements.txt
    if cmp --silent "$requirements" "$venv/made-from"; then
        echo "Python environment is up to date: $venv"
        return
    fi
    # Chained, because `set -e` does not reach into a function whose failure is handled.
    rm -rf "$venv" &&
        python3 -m venv "$venv" &&
        "$venv/bin/pip" install --quiet --requirement "$requirements" &&
        cp "$requirements" "$venv/made-from"
}

# Path of the command, built if need be.
platoon_path() {
    build_tests >&2
    echo "$target/debug/platoon"
}

# "MANIFEST_FOLDER<tab>BINARY" of every test binary of the packages that touch SocketCAN.
socketcan_binaries() {
    build_tests --message-format=json |
        sed -n '/"reason":"compiler-artifact"/{
            /"profile":{[^}]*"test":true/s|.*"manifest_path":"\([^"]*\)/Cargo.toml".*"executable":"\([^"]*\)".*|\1\t\2|p
        }' |
        awk -F '\t' -v root="$PWD" '$1 == root || $1 == root "/can-dbc" || $1 == root "/vcan-setup"'
}

# Of the lines of socketcan_binaries, those whose binary has a test for us: an ignored one that is
# neither heavy nor of the kernel step. The names of these tests go to the file $1.
with_ignored_tests() {
    local folder binary names
    while IFS=$'\t' read -r folder binary; do
        names=$("$binary" "${in_kernel[@]}" --list --format=terse | sed -n 's/: test$//p')
        if [[ -n $names ]]; then
            printf '%s\n' "$names" >>"$1"
            printf '%s\t%s\n' "$folder" "$binary"
        fi
    done
}

# Writes the script that runs in a kernel with CAN, as root of an otherwise empty network. It runs
# the binaries of standard input; rehearsals with can-utils beside them put what they leave into the
# folder $1.
write_socketcan_job() {
    local folder binary
    cat <<'TEXT'
set -e
ip link set lo up
# The kernel finds the modules of its interfaces by itself, unless it was booted for us.
booted=/usr/lib/uml/modules/$(uname -r)
if [ -d "$booted" ]; then
    insmod "$booted/kernel/drivers/net/dummy.ko"
    # It is slow, and canbusload and cansniffer have no option for a larger buffer.
    echo 16777216 >/proc/sys/net/core/rmem_default
fi
for interface in vcan0 vcan1 vcan2; do
    ip link add "$interface" type vcan
done
ip link set vcan0 mtu 72 up # fit for CAN FD
ip link set vcan1 mtu 16 up # classic frames only
ip link set vcan2 mtu 72    # left down
status=0
TEXT
    while IFS=$'\t' read -r folder binary; do
        printf 'cd %q\n%q %s --test-threads=1 --color=never || status=1\n' \
            "$folder" "$binary" "${in_kernel[*]}"
    done
    printf 'cd %q\n' "$PWD"
    if can_utils_at_hand; then
        printf '%q tests/interop/can_utils_run.py %q %q || status=1\n' \
            "$venv/bin/python" "$(platoon_path)" "$1"
    fi
    printf 'exit %s\n' "\$status"
}

# What candump logged beside the rehearsals of the job in folder $1 against what they recorded.
compare_candump_logs() {
    local act
    can_utils_at_hand ||
        leave_out "can-utils beside rehearsals: can-utils or the Python environment is missing"
    for act in clean hostile j1939; do
        python tests/interop/candump_equals_mcap.py "$1/$act/run/run.mcap" "$1/$act"/candump-*.log
    done
    read_candump_log "$1/clean/run/run.mcap" "$1/clean"/candump-*.log
    read_candump_log "$1/j1939/run/run.mcap" "$1/j1939"/candump-*.log can-dbc/j1939.dbc
    python tests/interop/canbusload_equals_model.py "$1/j1939/run/run.mcap" \
        "$1/j1939/canbusload.txt" "$(example_path frame_bits)"
}

# Has other programs read a log; those that are not installed are named in the summary.
read_candump_log() {
    python tests/interop/candump_readers.py "$@" | tee "$scratch/readers"
    sed -n 's/^left out: //p' "$scratch/readers" >>"$reasons"
}

can_utils_at_hand() {
    [[ -x $venv/bin/python ]] && has candump
}

# Runs a command as root of a network namespace of its own, so that nobody's interfaces are touched.
in_own_network() {
    if is_root; then
        unshare --net "$@"
    else
        unshare --map-root-user --net "$@"
    fi
}

kernel_makes_vcan() {
    if is_root && has modprobe; then
        modprobe --quiet --all vcan can_raw || true
    fi
    in_own_network ip link add probe type vcan 2>/dev/null
}

# ---------------------------------------------------------------- the steps

step_install() {
    local missing
    mapfile -t missing < <(missing_packages)
    if [[ ${#missing[@]} -gt 0 ]] && is_root && has apt-get; then
        install_packages "${missing[@]}"
        mapfile -t missing < <(missing_packages)
    fi
    if has python3; then
        make_venv || leave_out "no Python environment: see the message above"
    else
        missing+=(python3)
    fi
    if [[ ${#missing[@]} -gt 0 ]]; then
        leave_out "missing: ${missing[*]} (as root on Debian or Ubuntu this step installs them)"
    fi
}

step_fmt() {
    cargo fmt --all --check
}

step_shell() {
    has shellcheck || leave_out "shellcheck is not installed"
    shellcheck test.sh .ci/run
}

step_clippy() {
    cargo clippy --locked --workspace --all-targets -- -D warnings
}

step_doc() {
    RUSTDOCFLAGS="-D warnings" cargo doc --locked --workspace --no-deps
}

step_test() {
    cargo test --locked --workspace --no-fail-fast
}

step_interop() {
    [[ -x $venv/bin/python ]] || leave_out "no Python environment in $venv: run the install step"
    python tests/interop/cantools_codec.py "$(example_path codec_vectors)"
    python tests/interop/python_can_udp.py "$(example_path udp_peer)"
    python tests/interop/python_can_run.py "$(platoon_path)"
    "$(example_path sample_run)" "$scratch/sample"
    python tests/interop/mcap_readers.py "$scratch/sample/run.mcap"
    python tests/interop/foxglove_live.py "$(platoon_path)" "$scratch/live"
    python tests/interop/commonroad_plant.py "$(example_path plant_trajectories)"
    python tests/interop/cvxpy_gains.py controller-rt/gains
}

# The page that a run leaves, in headless Chromium.
step_page() {
    [[ -x $venv/bin/python ]] || leave_out "no Python environment in $venv: run the install step"
    has chromium || leave_out "chromium is not installed: run the install step as root"
    python tests/interop/report_page.py "$(platoon_path)" "$scratch/page"
}

# The default scenario as users get it must pass; a few seconds of it are read by stock readers.
step_rehearse() {
    local platoon=$target/release/platoon trace=$scratch/short/run.mcap status=0
    cargo build --quiet --locked --release --bin platoon
    "$platoon" rehearse obstacle-avoidance --virtual-time --out "$scratch/whole"
    "$platoon" rehearse obstacle-avoidance --virtual-time --duration-s 3 --out "$scratch/short" \
        >"$scratch/short.txt" 2>&1 || status=$?
    # Three seconds are too few to pass any obstacle, so the behaviour may fail; nothing else may.
    [[ $status -le 1 ]] || {
        cat "$scratch/short.txt" >&2
        return "$status"
    }
    [[ -s $trace ]] || {
        echo "the rehearsal left no run.mcap" >&2
        return 1
    }
    [[ -x $venv/bin/python ]] || leave_out "run.mcap not read by Python: run the install step"
    python tests/interop/mcap_readers.py "$trace"
    # Frames from its tenth second on only.
    "$platoon" rehearse obstacle-avoidance --virtual-time --rate-hz 100 --duration-s 25 \
        --capture 'clearance<2' --out "$scratch/captured" >"$scratch/captured.txt" 2>&1 || true
    python tests/interop/mcap_readers.py "$scratch/captured/run.mcap"
    python tests/interop/exported_run.py "$platoon" "$trace"
    python tests/interop/played_run.py "$platoon" "$trace"
}

# Ends the step, with the names of its tests, when platoon vcan shell has no kernel to boot; fails
# where nobody reads the summary.
need_kernel() {
    local status=0
    "$(platoon_path)" vcan shell --interfaces 0 -- true || status=$?
    if [[ $status -eq $no_kernel_status && ${CI:-} != true ]]; then
        leave_out "no kernel to boot (see above); tests left out:" "$@"
    fi
    return "$status"
}

step_kernel() {
    local tests names
    tests=$(socketcan_binaries | awk -F '\t' -v root="$PWD" '$1 == root && $2 ~ /\/it-[^\/]*$/ { print $2 }')
    names=$("$tests" vcan_shell:: --ignored --list --format=terse | sed -n 's/: test$//p')
    need_kernel "$names"
    "$tests" vcan_shell:: --ignored --test-threads=2
}

step_socketcan() {
    local names=$scratch/socketcan-names job=$scratch/socketcan-job.sh runs=$scratch/socketcan
    socketcan_binaries | with_ignored_tests "$names" | write_socketcan_job "$runs" >"$job"
    [[ -s $names ]] || {
        echo "found no SocketCAN test to run" >&2
        return 1
    }
    echo "tests/interop/can_utils_run.py" >>"$names"

    if kernel_makes_vcan; then
        echo "in a network namespace of this kernel, $(uname -r)"
        in_own_network sh "$job"
    else
        echo "this kernel makes no vcan interface: in one that platoon vcan shell boots"
        need_kernel "$(<"$names")"
        timeout --kill-after=30 "$socketcan_limit_s" "$(platoon_path)" vcan shell \
            --interfaces 0 --memory-mb 2048 -- sh "$job"
    fi
    compare_candump_logs "$runs"
}

# The long sweeps of --long. A test belongs here when it is ignored and its name begins with heavy_.
# The benchmarks run too, so that none of them rots; their figures decide nothing.
step_heavy() {
    cargo test --locked --release --workspace --no-fail-fast -- --ignored heavy_
    cargo bench --locked --workspace --bench codec --bench inbox --bench law --bench recorder
}

# ---------------------------------------------------------------- running them

passed=0 failed=0 summary=() failed_steps=()

# Runs one step in a shell of its own, so that `set -e` holds inside and it can end early.
run_step() {
    local name=$1 began=$SECONDS status line log=$scratch/log-$1
    printf '\n== %s\n' "$name"
    : >"$reasons"
    set +e
    (
        set -e
        "step_$name"
    ) 2>&1 | tee "$log"
    status=${PIPESTATUS[0]}
    set -e
    case $status in
    0)
        passed=$((passed + 1))
        line=passed
        ;;
    "$left_out_status")
        line="left out"
        ;;
    *)
        failed=$((failed + 1))
        line="FAILED (exit status $status)"
        failed_steps+=("$name")
        ;;
    esac
    summary+=("$(printf '%-10s %5d s  %s' "$name" "$((SECONDS - began))" "$line")")
    if [[ -s $reasons ]]; then
        summary+=("$(sed 's/^/                    /' "$reasons")")
    fi
    printf -- '-- %s: %s, %d s\n' "$name" "$line" "$((SECONDS - began))"
}

long=false install=true steps=()
for argument in "$@"; do
    case $argument in
    -h | --help)
        usage
        exit 0
        ;;
    --long) long=true ;;
    --no-install) install=false ;;
    *)
        if [[ " ${all_steps[*]} " != *" $argument "* ]]; then
            echo "test.sh: unknown argument '$argument'; see ./test.sh --help" >&2
            exit 2
        fi
        steps+=("$argument")
        ;;
    esac
done
if [[ ${#steps[@]} -eq 0 ]]; then
    steps=("${all_steps[@]}")
    $long || unset 'steps[-1]'
    $install || unset 'steps[0]'
fi

has cargo || {
    echo "test.sh: no cargo; install Rust 1.89 or newer with rustup" >&2
    exit 2
}
target=$(cargo metadata --no-deps --format-version 1 |
    sed 's/.*"target_directory":"\([^"]*\)".*/\1/')
venv=$target/test-venv
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
reasons=$scratch/reasons

for step in "${steps[@]}"; do
    run_step "$step"
done

# A step's output may be thousands of lines up by now.
for step in "${failed_steps[@]}"; do
    printf '\n== %s failed; of its output, what looks like the reason, and the end:\n' "$step"
    grep --extended-regexp --after-context=6 \
        'FAILED|panicked at|^error|^Error|^Traceback|Error:' "$scratch/log-$step" | head -n 80 || true
    printf '...\n'
    tail -n 20 "$scratch/log-$step"
done
printf '\n== summary\n'
printf '%s\n' "${summary[@]}"
printf '%d passed, %d failed\n' "$passed" "$failed"
[[ $failed -eq 0 ]]
