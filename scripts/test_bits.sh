#!/usr/bin/env bash
# The same bits on other machines: runs short scenes on this processor, without the fused multiply-add of its C library, on an emulated
# processor without AVX and FMA (Nehalem, 2008), and on an emulated arm64 machine, and compares their state_hash.
#
#     scripts/test_bits.sh
#
# Needs qemu-user (qemu-x86_64, qemu-aarch64; Debian: qemu-user). For arm64 it builds the program where rustc has the target
# aarch64-unknown-linux-gnu and aarch64-linux-gnu-gcc is there (Debian: gcc-aarch64-linux-gnu); GRAINTRAIN_ARM64 names one built elsewhere.
# What is missing is said and not tested.
set -euo pipefail
cd "$(dirname "$0")/.."

target=$(realpath -m "${CARGO_TARGET_DIR:-target}")
cargo build --release --locked
program=$target/release/graintrain
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

# Every solver that a step takes by itself, joints, meshes, hulls, stages, streams, sizes and formulas from functions.
scenes=(
    "sedimentation --set n=2 --steps 20"
    "sedimentation --set n=5 --steps 12"
    "direct-shear --set n=2 --steps 20"
    "direct-shear --set n=2 --steps 20 --friction relaxed"
    "excavator --steps 4"
    "excavator --steps 4 --friction relaxed"
    "shear-box --steps 10"
    "hopper --steps 20"
    "repose --steps 10"
    "drafting --steps 20"
)

machines=("this processor" "C library without FMA")
commands=("$program" "env GLIBC_TUNABLES=glibc.cpu.hwcaps=-FMA,-AVX2 $program")
if command -v qemu-x86_64 > /dev/null; then
    machines+=("Nehalem")
    commands+=("qemu-x86_64 -cpu Nehalem $program")
else
    echo "not tested for want of qemu-x86_64: a processor without AVX and FMA"
fi
arm=${GRAINTRAIN_ARM64:-}
if [ -z "$arm" ] && command -v aarch64-linux-gnu-gcc > /dev/null &&
    [ -d "$(rustc --print sysroot)/lib/rustlib/aarch64-unknown-linux-gnu" ]; then
    CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER=aarch64-linux-gnu-gcc \
        cargo build --release --locked --target aarch64-unknown-linux-gnu
    arm=$target/aarch64-unknown-linux-gnu/release/graintrain
fi
if [ -n "$arm" ] && command -v qemu-aarch64 > /dev/null; then
    machines+=("arm64")
    commands+=("qemu-aarch64 -L /usr/aarch64-linux-gnu $arm")
else
    echo "not tested for want of a program for arm64 or of qemu-aarch64: arm64"
fi

passed=0
failed=0
for scene in "${scenes[@]}"; do
    first=""
    for k in "${!machines[@]}"; do
        rm -rf "$folder/run"
        # Words of a command and of a scene are told apart by blanks.
        # shellcheck disable=SC2086
        ${commands[$k]} run $scene --threads 1 --quiet --out "$folder/run" > "$folder/log" 2>&1 ||
            { cat "$folder/log"; exit 1; }
        hash=$(grep -o '"state_hash": *"[^"]*"' "$folder/run/summary.json")
        first=${first:-$hash}
        if [ "$hash" = "$first" ]; then
            passed=$((passed + 1))
        else
            failed=$((failed + 1))
            echo "other bits: $scene on ${machines[$k]}: $hash, on ${machines[0]}: $first"
        fi
    done
done
echo "bits: ${#scenes[@]} scenes on: $(IFS=,; echo "${machines[*]}")"
echo "$passed passed, $failed failed"
[ "$failed" = 0 ]
