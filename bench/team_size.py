"""How what a trained team returns, how long its tick takes and how fast it learns change with its size: a table as CSV, and a plot.

    python3 bench/team_size.py target/release/vamaro-swarm docs/benchmarks/team-size POLICY ..

Each policy plays 400 episodes in one process for what it returns, and three times 200 as processes at p = 0.2 for its imputation error and
its ticks. Then a team like it trains for 100,000 env steps on one thread, without tests. Needs matplotlib.
"""

import csv
import json
import re
import statistics
import subprocess
import sys
import tempfile

IMPUTERS = ["dynamics", "value-aware", "hold"]


def main(program, out, *policies):
    rows = [measure(program, policy) for policy in policies]
    with open(f"{out}.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys())
        writer.writeheader()
        writer.writerows(rows)
    draw(rows, f"{out}.svg")


def measure(program, policy):
    def run(*words):
        return subprocess.run([program, *words], check=True, capture_output=True, text=True).stdout

    words = ["--levels", "1,0", "--imputers", ",".join(IMPUTERS), "--episodes", "400", "--in-process", "--json"]
    group = json.loads(run("evaluate", policy, *words))["groups"][0]
    cells = {imputer["imputer"]: imputer["cells"] for imputer in group["imputers"]}
    words = ["--policy", policy, "--p", "0.2", "--episodes", "200", "--json"]
    swarms = [json.loads(run("spawn", *words)) for _ in range(3)]
    with tempfile.TemporaryDirectory() as folder:
        words = ["--preset", "team", "--steps", "100k", "--in-process", "--threads", "1", "--set", "test_episodes=0"]
        learned = run("train", "--task", group["task"], *words, "--out", f"{folder}/run")
    return {
        "task": group["task"],
        "agents": swarms[0]["agents"],
        "uniform actions": round(group["random"]["value"], 1),
        "p = 1": round(cells["hold"][0]["mean"]["value"], 1),
        **{f"{name}, p = 0": round(cells[name][1]["mean"]["value"], 1) for name in IMPUTERS},
        **{f"score of {name}, p = 0": round(cells[name][1]["score"]["value"], 3) for name in IMPUTERS},
        "imputation error": round(swarms[0]["imputation_rmse"], 4),
        "tick, us": round(statistics.median(swarm["tick_p50_us"] for swarm in swarms), 1),
        "env steps per s": int(re.findall(r"(\d+)/s", learned)[-1]),
    }


def draw(rows, path):
    import matplotlib

    matplotlib.use("svg")
    from matplotlib import pyplot

    panels = {
        "score at p = 0": [f"score of {name}, p = 0" for name in IMPUTERS],
        "imputation error at p = 0.2": ["imputation error"],
        "tick, us": ["tick, us"],
        "env steps learned from per s": ["env steps per s"],
    }
    figure, axes = pyplot.subplots(1, 4, figsize=(14, 3.2), layout="constrained")
    families = {"spread-blindfold": "-", "spread-xy": "--"}
    for axis, (title, columns) in zip(axes, panels.items()):
        for at, column in enumerate(columns):
            for family, dashes in families.items():
                team = sorted((row for row in rows if row["task"].startswith(family)), key=lambda row: row["agents"])
                name = f"{family}, {column.split(',')[0].removeprefix('score of ')}" if len(columns) > 1 else family
                sizes, values = [row["agents"] for row in team], [row[column] for row in team]
                axis.plot(sizes, values, dashes, marker="o", color=f"C{at}", label=name)
        axis.set(title=title, xlabel="agents", xticks=[2, 3, 4, 6, 8, 12])
        axis.set_ylim(bottom=min(0, axis.get_ylim()[0]))
    axes[0].legend(fontsize=7)
    axes[3].legend(fontsize=7)
    figure.savefig(path, metadata={"Date": None})


if __name__ == "__main__":
    main(*sys.argv[1:])
