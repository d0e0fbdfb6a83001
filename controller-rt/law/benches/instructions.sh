#!/usr/bin/env bash
# Instructions of one call of every part of a step, by callgrind: a figure that no other load on the
# machine can move. Needs valgrind; RUSTFLAGS is yours to set.
set -euo pipefail

cd "$(dirname "$(realpath "${BASH_SOURCE[0]}")")"
program=$(cargo bench --locked --package law --bench law --no-run --message-format=json |
    sed -n 's/.*"kind":\["bench"\].*"executable":"\([^"]*\)".*/\1/p')

# Instructions of the whole program when it calls a part TIMES times over: counted PART TIMES
counted() {
    valgrind --tool=callgrind --callgrind-out-file=/dev/null "$program" --count "$1" "$2" 2>&1 |
        sed -n 's/.*Collected : //p'
}

printf '%-18s %12s\n' part "instructions"
for part in step linearise qp-cold qp-warm qp-degenerate qp-degenerate-warm; do
    calls=$("$program" --count "$part" 1 | cut -d' ' -f2)
    printf '%-18s %12s\n' "$part" $((($(counted "$part" 2) - $(counted "$part" 1)) / calls))
done
