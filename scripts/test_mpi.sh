#!/usr/bin/env bash
# Builds graintrain-mpi and holds it against the ordinary program: the same state_hash for 1 and 2 threads and for 1 to 4 ranks, with relaxed
# and exact friction, and after kills of ranks and of mpirun at random moments. Ranks may be more than processors.
#
#     scripts/test_mpi.sh [--quick]
#
# Needs Open MPI (Debian: openmpi-bin libopenmpi-dev); where it is missing, root's apt-get is asked for it. Without it nothing is
# tested, which is said and counted. --quick makes fewer steps and kills.
set -euo pipefail
cd "$(dirname "$0")/.."

quick=""
[ "${1:-}" = "--quick" ] && quick=yes

if ! command -v mpicc > /dev/null || ! command -v mpirun > /dev/null; then
    if [ "$(id -u)" = 0 ] && command -v apt-get > /dev/null; then
        echo "installing Open MPI"
        { apt-get update -qq && apt-get install -y -qq openmpi-bin libopenmpi-dev; } > /dev/null 2>&1 || true
    fi
fi
if ! command -v mpicc > /dev/null || ! command -v mpirun > /dev/null; then
    echo "skipped for want of MPI: 6 scenes on 1 to 4 ranks, kills of ranks and of mpirun"
    exit 0
fi

CARGO_TARGET_DIR=$(realpath -m "${CARGO_TARGET_DIR:-target}")
# With the features of tests, so that it takes what was compiled for them.
mpi=(--workspace --bin graintrain-mpi --features graintrain-mpi/mpi,graintrain-testdata/as-tested --locked)
cargo clippy "${mpi[@]}" -- -D warnings
cargo build "${mpi[@]}" --bin graintrain
target=$CARGO_TARGET_DIR/debug
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

# Root is asked twice by Open MPI whether it is sure.
export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1

mpirun=(mpirun --oversubscribe --mca mpi_yield_when_idle 1)

on_ranks() {
    local ranks=$1
    shift
    "${mpirun[@]}" -n "$ranks" "$target/graintrain-mpi" "$@"
}

hash_of() {
    sed -n 's/.*"state_hash": "\(.*\)".*/\1/p' "$1/summary.json"
}

# Ends the script unless the run in a folder has this hash and has shared its work among more than one rank.
expect() {
    local what=$1 out=$2 hash=$3 found
    found=$(hash_of "$out")
    if [ "$found" != "$hash" ]; then
        echo "FAILED: $what: state_hash $found, expected $hash" >&2
        exit 1
    fi
}

# A scene on threads and on ranks.
compare() {
    local name=$1 out hash threads ranks
    shift
    out="$folder/$name"
    "$target/graintrain" run "$@" --threads 1 --quiet --out "$out"
    hash=$(hash_of "$out")
    for threads in 2; do
        "$target/graintrain" run "$@" --threads "$threads" --quiet --force --out "$out"
        expect "$name, $threads threads" "$out" "$hash"
    done
    for ranks in 1 2 3 4; do
        on_ranks "$ranks" run "$@" --quiet --force --out "$out"
        expect "$name, $ranks ranks" "$out" "$hash"
        grep -q "\"ranks\": $ranks," "$out/summary.json"
        # Shared solves send slots; without them ranks exchange a few words per step.
        if [ "$ranks" = 2 ] && [ "$(sed -n 's/.*"communication_bytes": \([0-9]*\).*/\1/p' "$out/summary.json")" -lt 100000 ]; then
            echo "FAILED: $name: no solve was shared" >&2
            exit 1
        fi
    done
    on_ranks 2 run "$@" --threads 2 --quiet --force --out "$out"
    expect "$name, 2 ranks of 2 threads" "$out" "$hash"
    echo "$name: $hash on 1 and 2 threads, 1 to 4 ranks, 2 ranks of 2 threads"
}

steps=40
[ -n "$quick" ] && steps=12
compare sedimentation sedimentation --set n=4 --steps $steps
compare sedimentation-coulomb sedimentation --set n=4 --steps $steps --friction coulomb
compare direct-shear direct-shear --set n=3 --steps $steps
if [ -z "$quick" ]; then
    compare direct-shear-coulomb direct-shear --set n=3 --steps $steps --friction coulomb
fi
compare shapes scripts/mpi/shapes.toml --steps $steps
# A mechanism in grains: gradients are shared where friction is relaxed.
compare mechanism excavator --friction relaxed --steps 160

# Ranks that do not even begin: the first one says why, once.
if on_ranks 2 run no-such-scene > "$folder/refused" 2>&1; then
    echo "FAILED: a scene that is not there was run" >&2
    exit 1
fi
[ "$(grep -c 'no-such-scene' "$folder/refused")" = 1 ]

# Kills at random moments: a rank or mpirun, at once (KILL) or in good order (TERM); each leaves a checkpoint from which another number of ranks,
# or the ordinary program, goes on to the bits of the run that nobody killed.
kills=10
[ -n "$quick" ] && kills=3
scene=(sedimentation --set n=4 --set output.checkpoint_every="0.05 s" --steps 120)
"$target/graintrain" run "${scene[@]}" --quiet --out "$folder/whole"
hash=$(hash_of "$folder/whole")
broken=0
for kill in $(seq "$kills"); do
    out="$folder/killed"
    rm -rf "$out"
    "${mpirun[@]}" -n 2 "$target/graintrain-mpi" run "${scene[@]}" --quiet --out "$out" > "$folder/killed.log" 2>&1 &
    started=$!
    # After the first checkpoint, at the latest after half a minute.
    for _ in $(seq 300); do
        [ -n "$(ls "$out/checkpoints" 2> /dev/null)" ] && break
        sleep 0.1
    done
    sleep "$(awk -v seed="$RANDOM" 'BEGIN { srand(seed); printf "%.2f", 0.5 * rand() }')"
    mapfile -t ranks < <(pgrep -P "$started" -x graintrain-mpi)
    # Before there is a rank it is mpirun's turn.
    [ ${#ranks[@]} -gt 0 ] || ranks=("$started")
    case $((kill % 4)) in
        0) what="TERM to mpirun" victim=$started signal=TERM ;;
        1) what="KILL to a rank" victim=${ranks[-1]} signal=KILL ;;
        2) what="KILL to mpirun" victim=$started signal=KILL ;;
        3) what="TERM to a rank" victim=${ranks[0]} signal=TERM ;;
    esac
    kill -s "$signal" "$victim" 2> /dev/null || true
    begun=$SECONDS
    wait "$started" 2> /dev/null || true
    for rank in "${ranks[@]}"; do
        while kill -0 "$rank" 2> /dev/null; do
            if [ $((SECONDS - begun)) -gt 30 ]; then
                echo "FAILED: $what: rank $rank goes on for 30 s" >&2
                exit 1
            fi
            sleep 0.1
        done
    done
    if ! grep -q '"finished"' "$out/summary.json" 2> /dev/null; then
        broken=$((broken + 1))
        if [ ! -d "$out/checkpoints" ]; then
            # Killed before the first checkpoint.
            on_ranks 2 run "${scene[@]}" --quiet --force --out "$out"
        elif [ $((kill % 3)) = 0 ]; then
            "$target/graintrain" resume "$out" --quiet
        else
            on_ranks $((1 + kill % 3)) resume "$out" --quiet
        fi
    fi
    expect "resumed after $what" "$out" "$hash"
done
if [ "$broken" = 0 ]; then
    echo "FAILED: no run was broken by a kill" >&2
    exit 1
fi
echo "$kills kills, of which $broken broke the run: every resume ends in $hash"
