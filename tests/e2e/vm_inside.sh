#!/bin/sh
# Runs in the virtual machine of vm_capture.py, as root, with the tree read-only. Folders: ROOT BUILD
# Each check prints one line; the exit status is 1 if one failed.
set -u
root=$1 build=$2
work=/run/vm gadget=/sys/kernel/config/usb_gadget/head
probe=$build/tests/vm_probe
export PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=$work TMPDIR=$work LC_ALL=C
failed=0

# Waits up to $1 tenths of a second for a command.
within() {
    n=$1; shift
    while ! "$@" >/dev/null 2>&1; do
        n=$((n - 1))
        [ "$n" -gt 0 ] || return 1
        sleep 0.1
    done
}
check() { # NAME COMMAND ...
    name=$1; shift
    if timeout "${limit:-60}" "$@" >"$work/log" 2>&1; then
        echo "ok     $name: $(tr '\n' ';' <"$work/log")"
    else
        echo "FAILED $name ($?): $(tr '\n' ';' <"$work/log")"
        failed=1
    fi
}
# --- devices
gpio_on() {
    "$build/tests/vm_gpio" &
    gpio=$!
    within 50 test -e /dev/gpiochip0
}
# RATE VERSION_OF_PACKETS BCD_DEVICE
head_on() {
    mkdir -p $gadget && cd $gadget || return 1
    echo 0x1209 >idVendor; echo 0x5c41 >idProduct; echo "$3" >bcdDevice
    mkdir -p strings/0x409 configs/c.1 functions/ffs.head
    echo VM0001 >strings/0x409/serialnumber; echo "test head" >strings/0x409/product
    [ -e configs/c.1/ffs.head ] || ln -s functions/ffs.head configs/c.1
    mountpoint -q /run/ffs || mount -t functionfs head /run/ffs
    cd $work || return 1
    "$build/tests/vm_head" /run/ffs "$1" "$2" >$work/head.log 2>&1 &
    head=$!
    within 50 grep -q ready $work/head.log || return 1
    echo dummy_udc.0 >$gadget/UDC
    within 50 plugged
}
plugged() { grep -qs 5c41 /sys/bus/usb/devices/*/idProduct; }
head_off() {
    (echo "" >$gadget/UDC) 2>/dev/null # it may be unplugged already
    kill $head 2>/dev/null
    wait $head 2>/dev/null
    umount /run/ffs
}
usb_node() {
    for d in /sys/bus/usb/devices/*; do
        grep -qs 5c41 "$d/idProduct" && printf '/dev/bus/usb/%03d/%03d' "$(cat "$d/busnum")" "$(cat "$d/devnum")"
    done
}
# NAME KEY=VALUE ... : a board with some values changed
board() {
    mkdir -p "$work/$1"
    tty=/dev/ttyS1 product=0x5c41 serial=VM0001 chip=gpiochip0 index=0 video=/dev/video0
    file=$work/$1/board.yaml; shift
    for pair; do eval "${pair%%=*}=${pair#*=}"; done
    cat >"$file" <<END
name: vm
controller: {device: $tty, baud: 115200, parity: even, unit: 1, timeout_ms: 2000}
gpio: {chip: $chip, mirror_index: "$index", estop: "1", interlock: "2"}
${video:+camera: {device: $video\}}
head: {usb_vendor: 0x1209, usb_product: $product, serial: $serial}
END
}

echo "VM up after $(cut -d' ' -f1 /proc/uptime) s, Linux $(uname -r)"
gpio_on || { echo "FAILED no GPIO chip"; exit 1; }
head_on 25000 1 0x0100 || { echo "FAILED no gadget: $(cat $work/head.log)"; exit 1; }
within 50 test -e /dev/video0 || { echo "FAILED no camera"; exit 1; }

# --- data from each
cd $work
board board
board label chip=cp2112_gpio
check "data from four real devices" "$probe" take label 3

# --- absent, or something else
board tty tty=/dev/ttyS9; board head product=0x5c42; board other serial=VM0002; board chip chip=gpiochip7
board line index=77; board camera video=/dev/video9; board null video=/dev/null
check "absent devices" "$probe" refuse tty "not found" --port head "not found" lsusb other "not found" VM0002 \
    chip "not found" gpiochip7 line "not found" "'77'" camera "not found" /dev/video9 null unsupported "no camera"

# --- not allowed, one device after the other
for node in /dev/ttyS1 "$(usb_node)" /dev/gpiochip0 /dev/video0; do
    check "not allowed: $node" setpriv --reuid=65534 --clear-groups \
        "$probe" refuse board "not permitted" 70-scancart.rules
    chmod 666 "$node"
done

# --- a whole capture, if the program has it
if "$build/host/app/scancart" capture --help >/dev/null 2>&1; then
    . "$root/tests/e2e/vm_scan.sh"
fi

# --- unplugged in the middle, another version
check "head unplugged" "$probe" unplug board head "echo '' >$gadget/UDC"
head_off; head_on 25000 2 0x0100
check "packets of another version" "$probe" version board
head_off; head_on 25000 1 0x0200
check "head of another version" "$probe" refuse board unsupported "version 2"
head_off; head_on 25000 1 0x0100
check "camera unplugged" "$probe" unplug board camera "echo vivid.0 >/sys/bus/platform/drivers/vivid/unbind"
board blind video=
check "chip unplugged" "$probe" unplug blind lines "kill $gpio"
head_off
exit $failed
