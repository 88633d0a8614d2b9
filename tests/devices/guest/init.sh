#!/bin/busybox sh
# The guest's first process: kernel modules, the host's / read-only as the root, one command there.
B=/bin/busybox
$B mount -t proc proc /proc
$B mount -t sysfs sys /sys
$B mount -t devtmpfs dev /dev
for module in /modules/*.ko; do
    $B insmod "$module" || echo "insmod failed: $module"
done
$B mount -t 9p -o trans=virtio,version=9p2000.L,ro,msize=524288,cache=loose hostroot /host ||
    echo "the host's / could not be mounted"
for folder in dev proc sys; do
    $B mount --bind "/$folder" "/host/$folder"
done
$B mount -t tmpfs tmpfs /host/run
$B mkdir -p /host/dev/shm
$B mount -t tmpfs tmpfs /host/dev/shm
$B ip link set lo up
echo "guest: up after $($B cut -d' ' -f1 /proc/uptime) s"
. /command.sh
echo "GUEST-EXIT-CODE $?"
$B poweroff -f
