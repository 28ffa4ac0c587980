# What the tests of hadalens-mpi share. HADALENS, HADALENS_MPI, MPIRUN and WORK are set. To be sourced.
if [ -z "$HADALENS_MPI" ] || [ -z "$MPIRUN" ]; then
    echo "skipped: MPI (Debian: libopenmpi-dev openmpi-bin) was not found by the build"
    exit 77
fi
here=$(cd "$(dirname "$0")" && pwd)
rm -rf "$WORK"
mkdir -p "$WORK"
cd "$WORK" || exit 1
# one machine: no ssh is looked for, and no permission to read the other ranks' memory
export OMPI_MCA_plm=isolated OMPI_MCA_btl_vader_single_copy_mechanism=none OMPI_MCA_rmaps_base_oversubscribe=1
export OMPI_MCA_mpi_yield_when_idle=1
root=()
[ "$(id -u)" != 0 ] || root=(--allow-run-as-root)
bad=0

# ranks N ARGUMENTS...: the program on N ranks.
ranks() {
    local count=$1
    shift
    "$MPIRUN" "${root[@]}" --oversubscribe -np "$count" "$HADALENS_MPI" "$@"
}

# must WHAT COMMAND...: a command that must succeed; its words are shown where it does not.
must() {
    local what=$1
    shift
    "$@" >must.txt 2>&1 || {
        echo "FAILED: $what: $*"
        tail -20 must.txt
        bad=1
    }
}

camera() {
    must camera "$HADALENS" simulate --preset sim300 --size 64x80 --window 24x24 --depths "$1" --lenses 9 --pairs 5 \
        --test 2 --seed 5 -o camera
}

finish() {
    [ $bad = 0 ] && echo "all well"
    exit $bad
}
