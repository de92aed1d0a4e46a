#!/usr/bin/env bash
# Fuzzes every parser of the program for a while: `fuzz/run.sh [seconds a target] [targets ..]`, 60 seconds by default.
# Needs cargo-fuzz (`cargo install cargo-fuzz`). The first build takes some minutes, which is why CI leaves it out.
# What is found is in fuzz/artifacts/, with a line that repeats it; new inputs stay out of the saved corpora.
set -euo pipefail
cd "$(dirname "$0")/.."

seconds=${1:-60}
shift || true
# cargo-fuzz asks for options that a stable compiler has but does not admit to.
export RUSTC_BOOTSTRAP=1
# No sanitizer: what is fuzzed is safe code, and a panic or too much memory is what is looked for.
fuzz() { cargo fuzz "$1" --sanitizer none "${@:2}"; }

targets=("$@")
[ ${#targets[@]} -gt 0 ] || mapfile -t targets < <(cargo fuzz list)
found=$(mktemp -d)
trap 'rm -rf "$found"' EXIT
for target in "${targets[@]}"; do
    mkdir -p "$found/$target"
    # 512 MB, and 10 s for one input, are far more than any of these files may take.
    fuzz run "$target" "$found/$target" "fuzz/corpus/$target" -- \
        -max_total_time="$seconds" -timeout=10 -rss_limit_mb=512 -max_len=100000 -print_final_stats=1
done
