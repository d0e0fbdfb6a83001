#!/usr/bin/env bash
# Runs a shell script in a kernel that has CAN, as an ordinary process: user-mode Linux, booted with
# the host's files as a read-only root. Needs no privilege, no KVM and no module on the host.
#
#   tests/uml/run.sh SCRIPT [SECONDS]
#
# Exit status: SCRIPT's own, or
#   124  still running after SECONDS (default 300)
#   125  the kernel does not boot here, or cannot load its CAN modules
#   126  the kernel died before SCRIPT ended
set -euo pipefail

script=$(realpath "${1:?usage: tests/uml/run.sh SCRIPT [SECONDS]}")
limit_s=${2:-300}
here=$(dirname "$(realpath "$0")")

complain() {
    echo "uml: $1" >&2
    exit 125
}

kernel=$(command -v linux.uml) || complain "no linux.uml; install the package user-mode-linux"
command -v insmod >/dev/null || PATH=$PATH:/usr/sbin:/sbin
command -v insmod >/dev/null || complain "no insmod; install the package kmod"
command -v ip >/dev/null || complain "no ip; install the package iproute2"

release=$("$kernel" --version | tail -n 1)
modules=${UML_MODULES:-/usr/lib/uml/modules/$release}
[[ -d $modules ]] || complain "no modules of kernel $release in $modules"

# Words of a kernel command line cannot contain blanks, so everything is put where there are none.
work=$(mktemp -d /tmp/platoon-uml.XXXXXX)
trap 'rm -rf "$work"' EXIT
cp "$here/init.sh" "$work/init"
cp "$script" "$work/job"
chmod +x "$work/init"
nonce=uml-$$-$RANDOM$RANDOM

boot() {
    timeout --kill-after=10 "$limit_s" "$kernel" mem=512M loglevel=1 quiet \
        rootfstype=hostfs rootflags=/ ro con=null con0=fd:0,fd:1 "umid=$nonce" "uml_dir=$work/" \
        "init=$work/init" "uml_job=$work/job" "uml_nonce=$nonce" "uml_modules=$modules" \
        </dev/null 2>&1
}

# Only what the script prints is passed on; the kernel's own chatter stays in the console log.
set +e
boot | tr -d '\r' | tee "$work/console" |
    sed --unbuffered -n "/^$nonce booted/,/^$nonce exit/{/^$nonce /!p}"
booted=${PIPESTATUS[0]}
set -e

status=$(sed -n "s/^$nonce exit \([0-9]*\)$/\1/p" "$work/console")
if [[ -n $status ]]; then
    exit "$status"
elif ! grep -q "^$nonce booted" "$work/console"; then
    tail -n 5 "$work/console" >&2
    complain "kernel $release does not boot here (it ended with status $booted)"
elif [[ $booted -eq 124 || $booted -eq 137 ]]; then
    echo "uml: stopped after $limit_s s" >&2
    exit 124
fi
echo "uml: the kernel ended (status $booted) before the script did" >&2
exit 126
