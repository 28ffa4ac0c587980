#!/usr/bin/env bash
# The Slurm scripts of examples/slurm on a Slurm of its own: munged, slurmctld and slurmd of Debian, on this machine, in a
# folder, with a configuration that has two nodes' worth of tasks. As root; installs what is missing; ends what it started.
#   tests/cluster/slurm.sh HADALENS FOLDER
set -euo pipefail
[ $# = 2 ] || { sed -n '4s/^# *//p' "$0" >&2; exit 2; }
program=$(realpath "$1") work=$(realpath -m "$2")
cd "$(dirname "$0")/../.."
scripts=$PWD/examples/slurm
[ "$(id -u)" = 0 ] || { echo "Slurm is started as root: skipped"; exit 77; }
# the packages' own services are not started where there is a service manager
policy=/usr/sbin/policy-rc.d
daemons=() made=
finish() {
    for pid in "${daemons[@]}"; do kill "$pid" 2>/dev/null || true; done
    wait
    [ -z "$made" ] || rm -f "$made"
}
trap finish EXIT
if [ ! -e $policy ]; then
    made=$policy
    printf '#!/bin/sh\nexit 101\n' >$policy
    chmod +x $policy
fi
source examples/install.sh
hadalens_install cluster
[ ! -e "$work" ] || rm -rf "$work"
mkdir -p "$work"/{munge,state,spool,jobs}
export PATH=$(dirname "$program"):$(dirname "$program")/../mpi:$PATH SLURM_CONF=$work/slurm.conf
fail() {
    echo "FAILED: $*"
    tail -n 20 "$work"/*.log "$work"/jobs/*.log 2>/dev/null || true
    exit 1
}

# munged asks for folders that nobody else can write to
chmod 700 "$work/munge"
dd if=/dev/urandom of="$work/munge/key" bs=1024 count=1 status=none
chmod 600 "$work/munge/key"
munged --foreground --force --key-file="$work/munge/key" --socket="$work/munge/socket" --pid-file="$work/munge/pid" \
    --log-file="$work/munge/log" --seed-file="$work/munge/seed" >"$work/munged.log" 2>&1 &
daemons+=($!)
cores=$(nproc)
cat >"$SLURM_CONF" <<END
ClusterName=hadalens
SlurmctldHost=$(hostname -s)(127.0.0.1)
SlurmctldPort=46817
SlurmdPort=46818
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket=$work/munge/socket,cred_expire=5 # a job that is requeued waits as long
CredType=cred/munge
StateSaveLocation=$work/state
SlurmdSpoolDir=$work/spool
SlurmctldPidFile=$work/slurmctld.pid
SlurmdPidFile=$work/slurmd.pid
SlurmctldLogFile=$work/slurmctld.log
SlurmdLogFile=$work/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
ReturnToService=2
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
MailProg=/bin/true
NodeName=$(hostname -s) NodeAddr=127.0.0.1 CPUs=$cores State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
END
slurmctld -D -f "$SLURM_CONF" >"$work/controller.log" 2>&1 &
daemons+=($!)
slurmd -D -f "$SLURM_CONF" >"$work/node.log" 2>&1 &
daemons+=($!)
for _ in $(seq 60); do
    [ "$(sinfo -h -o %t 2>/dev/null)" != idle ] || break
    sleep 1
done
[ "$(sinfo -h -o %t)" = idle ] || fail "the node does not come up: $(sinfo -h -o %t 2>&1)"

# Submits a job and waits until it has ended; its exit code is that of the worst task.
submit() { sbatch --wait --parsable --chdir="$work/jobs" --cpus-per-task=1 "$@"; }
export HADALENS_SLURM=$scripts
cd "$work"
hadalens simulate --preset sim300 --size 96x128 --window 48x48 --depths 2 --pairs 4 --test 3 -o camera -q
alike=(--boundary circular --scene-response linear --exposure same)

submit --array=0-1 "$scripts/fit-array.sbatch" "$work/camera" "$work/sums" "${alike[@]}" >/dev/null || fail "the array of fits"
[ "$(ls sums)" = "$(printf '0.sums\n1.sums')" ] || fail "sums: $(ls sums)"
submit "$scripts/merge.sbatch" "$work/sums" "$work/merged.model" >/dev/null || fail "merging"
# one machine with all pairs; the scales of the two sums differ by rounding alone
hadalens fit camera -o whole.model --no-leave-one-out --crop-passes 0 "${alike[@]}" -q
submit --array=0-1 "$scripts/reconstruct-array.sbatch" "$work/camera/test/raw" "$work/merged.model" "$work/merged" --refine 0 \
    >/dev/null || fail "the array of frames"
hadalens reconstruct camera/test/raw/*.tif -m whole.model -o whole --refine 0 -q
[ "$(ls merged)" = "$(ls whole)" ] || fail "other files: $(ls merged whole)"
# the sums of both are doubles added in another order; pictures of a camera from half of the pairs are others
hadalens fit --merge sums/0.sums -o half.model --crop-passes 0 -q
hadalens reconstruct camera/test/raw/*.tif -m half.model -o half --refine 0 -q
difference() { # greatest mean absolute difference of stacks and all-in-focus images
    hadalens evaluate "$1" whole --json | python3 -c 'import json, sys
print(max(one["mae"] for one in json.load(sys.stdin)["files"] if one["kind"] != "distance_map"))'
}
merged=$(difference merged) half=$(difference half)
awk "BEGIN { exit !($merged < 1e-6 && $half > 1e-4) }" || fail "from the whole camera's pictures differ: $merged (merged), $half (half)"
echo "mean absolute difference to one machine's pictures: $merged; of half of the pairs: $half"

# submitted again after a loss: what is there stays, what is missing is made
rm sums/1.sums merged/*02*
touch -d '1 hour ago' sums/0.sums
submit --array=0-1 "$scripts/fit-array.sbatch" "$work/camera" "$work/sums" "${alike[@]}" >/dev/null || fail "the array, again"
[ "$(find sums -mmin +30 | wc -l)" = 1 ] && [ -s sums/1.sums ] || fail "the second submission did what was done"
submit --array=0-1 "$scripts/reconstruct-array.sbatch" "$work/camera/test/raw" "$work/merged.model" "$work/merged" --refine 0 \
    >/dev/null || fail "the array of frames, again"
[ "$(ls merged)" = "$(ls whole)" ] || fail "the second submission left frames out"
# ranks that share a command: the bits of one process for frames, its pictures for a fit
if command -v hadalens-mpi >/dev/null; then
    export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
    submit --ntasks=2 "$scripts/mpi.sbatch" reconstruct "$work"/camera/test/raw/*.tif -m "$work/whole.model" -o "$work/ranks" --refine 0 \
        >/dev/null || fail "frames shared by ranks"
    for file in whole/*.tif; do cmp "$file" "ranks/${file##*/}" || fail "ranks make other bits"; done
    submit --ntasks=2 "$scripts/mpi.sbatch" fit "$work/camera" -o "$work/ranks.model" --no-leave-one-out --crop-passes 0 "${alike[@]}" \
        >/dev/null || fail "a fit shared by ranks"
    hadalens reconstruct camera/test/raw/*.tif -m ranks.model -o shared --refine 0 -q
    shared=$(difference shared)
    awk "BEGIN { exit !($shared < 1e-6) }" || fail "the ranks' camera makes other pictures: $shared"
    # a training that is requeued as after the loss of a node, and warned once that its time is over, goes on both times;
    # it would take a day, so that it runs whenever one looks at it
    train=(train "$work/camera" -m "$work/whole.model" --steps 1000000 --batch 2 --seed 3 --validate-every 0 --show-every 0
        --save-every 20)
    begin() { sbatch --parsable --chdir="$work/jobs" --cpus-per-task=1 --ntasks=2 "$scripts/mpi.sbatch" "${train[@]}" "$@"; }
    restarts() { scontrol show job "$job" | sed -n 's/.*Restarts=\([0-9]*\).*/\1/p'; }
    state() { squeue -h -j "$job" -o %T; }
    steps() { tail -n +2 "$1/losses.csv" 2>/dev/null | wc -l; }
    until_so() { # WHAT CONDITION: waits for five minutes
        for _ in $(seq 600); do
            if eval "$2"; then return; fi
            sleep 0.5
        done
        fail "$1: $(scontrol show job "$job" | grep -E 'JobState|Restarts' | paste -sd' ')"
    }
    stop() {
        scancel "$job"
        until_so "the training does not end" '[ -z "$(state)" ] || [ "$(state)" = CANCELLED ]'
    }
    job=$(begin -o "$work/through.model" --log "$work/through.log")
    until_so "the training does not go on" '[ "$(steps through.log)" -ge 100 ]'
    stop
    job=$(begin -o "$work/on.model" --log "$work/on.log" --resume)
    until_so "the training does not begin" '[ -e on.log/checkpoint.safetensors ]'
    scontrol requeue "$job"
    until_so "the requeued training does not begin again" '[ "$(restarts)" = 1 ] && [ "$(state)" = RUNNING ]'
    before=$(steps on.log)
    until_so "the requeued training does not go on" '[ "$(steps on.log)" -gt "$before" ]'
    scancel --batch --signal=USR2 "$job"
    until_so "the training that was warned is not requeued" '[ "$(restarts)" = 2 ]'
    until_so "the training that was warned does not go on" '[ "$(state)" = RUNNING ] && [ "$(steps on.log)" -ge 100 ]'
    stop
    grep -q 'stopped after step' jobs/hadalens-mpi-"$job".log || fail "no rank said that it stopped and saved"
    # but for their seconds
    cmp <(head -n 101 through.log/losses.csv | cut -d, -f1-11) <(head -n 101 on.log/losses.csv | cut -d, -f1-11) ||
        fail "the training that went on has other losses"
else
    echo "hadalens-mpi is not built: jobs of ranks are left out"
fi
# a task that fails is seen
if submit "$scripts/merge.sbatch" "$work/nothing" "$work/x.model" >/dev/null 2>&1; then fail "a job that cannot succeed did"; fi
echo "all as expected"
