#!/bin/sh
# Prove that the README's commands work on a bare Debian: make a minimal system in a folder, clone
# the project into it and run a command there, timed. Needs root, debootstrap and room for 2 GB.
#
# Usage: tools/bare_machine.sh [options] [command...]      (command: make demo)
#   -d FOLDER    where the system is made (default: a folder under TMPDIR); kept for the next
#                run, in which only the clone is made anew
#   -s SUITE     Debian's name (default: bookworm)
#   -p PACKAGES  comma-separated packages on the bare machine (default: make,git,ca-certificates;
#                then the set-up must get Python itself)
#   -b FOLDER    a folder of this machine that is seen there too, read-only (may be given again),
#                say one with packages that pip's settings here point at
#   -u           run as a user without root's rights, who cannot install system packages
#   -w           take the work tree as it stands instead of the last commit
# This machine's settings of pip, apt, name look-up and certificates go along.
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
bare=${TMPDIR:-/tmp}/starling-bare
suite=bookworm
packages=make,git,ca-certificates
folders='' user=root tree=
while getopts d:s:p:b:uw option; do
    case $option in
    d) bare=$OPTARG ;;
    s) suite=$OPTARG ;;
    p) packages=$OPTARG ;;
    b) folders="$folders $OPTARG" ;;
    u) user=newcomer ;;
    w) tree=1 ;;
    *) exit 2 ;;
    esac
done
shift $((OPTIND - 1))
[ $# -gt 0 ] || set -- make demo

if [ ! -e "$bare/.made" ]; then
    debootstrap --variant=minbase --include="$packages" "$suite" "$bare" >"$bare.log"
    : >"$bare/.made"
fi

# Settings: as on this machine; the user's own settings of pip become everybody's.
bring() {
    [ -e "$1" ] || return 0
    rm -rf "${bare:?}$2"
    mkdir -p "$(dirname "$bare$2")"
    cp -RL "$1" "$bare$2"
}
for path in /etc/resolv.conf /etc/hosts /etc/pip.conf /etc/ssl/certs/ca-certificates.crt \
    /etc/apt/sources.list /etc/apt/sources.list.d /etc/apt/apt.conf.d; do
    bring "$path" "$path"
done
bring "$HOME/.config/pip/pip.conf" /etc/xdg/pip/pip.conf

# The newcomer's clone.
home=$bare/home/newcomer
mkdir -p "$home"
rm -rf "$home/starling"
if [ -n "$tree" ]; then
    mkdir "$home/starling"
    git -C "$root" ls-files -z --cached --others --exclude-standard |
        (cd "$root" && xargs -0 ls -d 2>/dev/null | tar -cf - -T -) | tar -xf - -C "$home/starling"
else
    git clone --quiet --no-hardlinks "$root" "$home/starling"
fi
chroot "$bare" sh -c 'id newcomer >/dev/null 2>&1 || useradd --no-create-home newcomer'
chroot "$bare" chown -R "$user" /home/newcomer

settings=$(env | grep -E '^(PIP_[A-Z_]+|[a-z]+_proxy|[A-Z]+_PROXY|SSL_CERT_[A-Z]+)=' || true)
began=$(date +%s)
status=0
(
    IFS='
'
    # A mount namespace of its own: nothing stays mounted behind, whatever happens.
    # shellcheck disable=SC2016,SC2086 # The inner shells expand; one setting a line.
    exec env -i $settings HOME=/home/newcomer PATH=/usr/sbin:/usr/bin:/sbin:/bin LANG=C.UTF-8 \
        unshare --mount --propagation private sh -c '
            set -e
            bare=$1 user=$2 folders=$3
            shift 3
            mount --bind /proc "$bare/proc"
            mount --bind /dev "$bare/dev"
            mount -t tmpfs -o mode=1777 tmpfs "$bare/dev/shm"
            for folder in $folders; do
                mkdir -p "$bare$folder"
                mount --bind -o ro "$folder" "$bare$folder"
            done
            exec chroot --userspec="$user" "$bare" \
                sh -c "cd /home/newcomer/starling && exec \"\$@\"" sh "$@"
        ' sh "$bare" "$user" "$folders" "$@"
) || status=$?
echo "bare $suite, $user: '$*' ended with status $status after $(($(date +%s) - began)) s" >&2
exit "$status"
