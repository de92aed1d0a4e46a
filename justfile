# The daily commands. `just` lists them; `.ci/run` is what must hold before a change lands.

[private]
default:
    @just --list

# Format, lints and docs: before each commit
check:
    cargo fmt --all
    cargo clippy --release --all-targets -- -D warnings
    cargo clippy --release --no-default-features --all-targets -- -D warnings
    RUSTDOCFLAGS="-D warnings" cargo doc --release --no-deps

# All tests, or those with a word in their name
test word="":
    cargo test --release {{word}}

# Compare with the paper's code: worlds, agents, updates
verify:
    cargo run --release -- verify tests/data/recordings
    cargo run --release -- verify tests/data/traces
    cargo run --release -- verify tests/data/updates

# Any command of the program: `just run spawn --agents 4 --p 0.2`
run *words:
    cargo run --release -- {{words}}

# How fast worlds, decisions, ticks and training are here
bench:
    cargo run --release -- bench world
    cargo run --release -- bench agent
    cargo run --release -- bench latency
    cargo run --release -- bench train

# Put the program on the path, with its man pages
install:
    cargo install --locked --path .
    vamaro-swarm man ~/.local/share/man/man1

# Everything that must hold before a change lands
ci:
    .ci/run
