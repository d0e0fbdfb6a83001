#!/bin/sh
# First process of the kernel that run.sh boots: load CAN, run the job, report its exit status on
# the console, power off. The root folder is the host's, read-only.
#
# The kernel passes these words of its command line on as environment variables:
#   uml_job     the shell script to run
#   uml_nonce   a word that marks the two lines meant for run.sh
#   uml_modules folder of the modules that belong to this kernel
# shellcheck disable=SC2154 # these three are assigned outside, as said above
export PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin
echo "$uml_nonce booted"

mount -t proc proc /proc
mount -t sysfs sysfs /sys
mount -t tmpfs tmpfs /run
mkdir -p /run/tmp /run/home
# The host's /tmp stays visible, because the job and the test binaries may lie in it.
export TMPDIR=/run/tmp HOME=/run/home

status=0
for module in net/can/can net/can/can-raw drivers/net/can/dev/can-dev drivers/net/can/vcan; do
    insmod "$uml_modules/kernel/$module.ko" || status=125
done
ip link set lo up || status=125

if [ "$status" -eq 0 ]; then
    sh "$uml_job"
    status=$?
fi
echo "$uml_nonce exit $status"
echo o >/proc/sysrq-trigger
# Power-off is asynchronous; the kernel would panic if its first process ended before.
sleep 60
