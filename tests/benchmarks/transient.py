"""What `fast` costs beside the published scheme: `python -m tests.benchmarks.transient`.

Every figure is from this one run, on one core; medians over repetitions, methods taken in turns.
"""

from __future__ import annotations

import statistics
import time

from threadpoolctl import threadpool_limits

from fivcore import Rig, Scene, simulate, simulate_many
from fivcore.contact.reduced import reduced_model
from fivcore.transient.published import STEP
from studies.motion.jobs import BATCH_MULTIPLE
from tests.benchmarks.stability import machine

SPEEDS = (1e-3, 2e-3, 5e-3)


def seconds(scene: Scene, duration: float, method: str, **given: object) -> float:
    """Wall time of one run."""
    start = time.perf_counter()
    simulate(scene, duration, method, **given)
    return time.perf_counter() - start


def together(scene: Scene, duration: float, count: int, **given: object) -> float:
    """Wall time of one of many repeat runs side by side, which differ by the ramp."""
    ramps = [1e-3 * (1.0 + 0.013 * (k % 64)) for k in range(count)]
    start = time.perf_counter()
    simulate_many([scene] * count, duration, ramp=ramps, **given)
    return (time.perf_counter() - start) / count


def methods(repeat: int = 5, count: int = 2 * BATCH_MULTIPLE) -> None:
    """Wall time per simulated second of `paper` and `fast` at the paper's speeds, and the ratio in a sweep."""
    print(
        f"\nA simulated second by `paper` (of 0.3 s), and by `fast` (of 3 s): {count} scenes side by side, every"
    )
    print("step taken and with skips, and one alone.\n")
    print("| V, mm/s | `paper`, s | us a step | every step, ms | ns a step | skips, ms | alone, ms | ratio |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    step = reduced_model(Rig(), 5.0).default_step
    for V in SPEEDS:
        scene = Scene(V, 5.0, 0.2, 9.0)
        # A long run of `fast`, so that its onset and the first stick weigh what they do in a study.
        seconds(scene, 0.01, "paper")
        together(scene, 0.1, count)
        columns: dict[str, list[float]] = {name: [] for name in ("paper", "all", "skips", "alone", "ratio")}
        for _ in range(repeat):
            columns["paper"].append(seconds(scene, 0.3, "paper") / 0.3)
            columns["all"].append(together(scene, 3.0, count, leap=False) / 3.0)
            columns["skips"].append(together(scene, 3.0, count) / 3.0)
            columns["alone"].append(seconds(scene, 3.0, "fast") / 3.0)
            columns["ratio"].append(columns["paper"][-1] / columns["skips"][-1])
        paper, every, skips, alone, ratio = (statistics.median(each) for each in columns.values())
        print(
            f"| {V * 1e3:g} | {paper:.1f} | {paper * STEP * 1e6:.3f} | {every * 1e3:.2f}"
            f" | {every * step * 1e9:.1f} | {skips * 1e3:.2f} | {alone * 1e3:.1f} | {ratio:.0f} |"
        )


def main() -> None:
    """Print the table."""
    with threadpool_limits(1):
        print(machine())
        methods()


if __name__ == "__main__":
    main()
