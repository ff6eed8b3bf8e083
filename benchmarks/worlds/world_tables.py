"""World generation: worlds a second, where the time goes, memory by the size of a job, and how good the worlds are.

    .venv/bin/python benchmarks/worlds/world_tables.py [--quick] [--document docs/guide/worlds.md]
    .venv/bin/python benchmarks/worlds/world_tables.py --quality [--seeds N] [--document
    docs/guide/worlds.md]

A world counts with its certificate and its canonical JSON, as the job gets it. Worlds a second are measured once all
processes run and are warm; `start s` is what comes before. `--document` puts the tables into the document, too.
"""

from collections.abc import Mapping, Sequence

from benchmarks.harness import markdown, options, show
from benchmarks.worlds.world_memory import JobFigures, measure_memory
from benchmarks.worlds.world_quality import example_certificate, measure_quality, quality_tables
from benchmarks.worlds.world_speed import INTERIORS, WORKERS, Case, Rate, measure_rates, measure_stages, middle
from benchmarks.worlds.world_templates import AIMS_PER_S, SPEED_TEMPLATES

_STAGE_WORLDS = 100
_JOBS = (100, 1_000, 10_000)
_REPEATS, _SECONDS = 5, 3.0
_QUICK_REPEATS, _QUICK_SECONDS = 3, 1.0

Stages = Mapping[tuple[str, int], Mapping[str, float]]


def speed_table(rates: Mapping[Case, Sequence[Rate]]) -> str:
    """Returns worlds a second by template and interiors, on one core and on two."""
    rows = [("template", "interiors", "1 core", "cpu ms", "2 cores", "range", "ratio", "start s", "aim")]
    for template in SPEED_TEMPLATES:
        for interiors in INTERIORS:
            one, two = (rates[Case(template, interiors, workers)] for workers in WORKERS)
            alone, both = (middle(each, lambda rate: rate.per_s) for each in (one, two))
            spread = sorted(rate.per_s for rate in two)
            rows.append(
                (
                    template,
                    f"{interiors}",
                    f"{alone:.0f}",
                    f"{middle(one, lambda rate: rate.cpu_ms):.1f}",
                    f"{both:.0f}",
                    f"{spread[0]:.0f}-{spread[-1]:.0f}",
                    f"{both / alone:.2f}",
                    f"{middle(two, lambda rate: rate.start_s):.1f}",
                    f"{AIMS_PER_S[template]}",
                )
            )
    return markdown(rows)


def stage_table(stages: Stages) -> str:
    """Returns milliseconds and share of each stage on one core."""
    names = list(next(iter(stages.values())))
    rows = [("template", "interiors", *names)]
    for (template, interiors), spent_ms in stages.items():
        cells = [f"{ms:.1f} ({100 * ms / spent_ms['all']:.0f} %)" for ms in spent_ms.values()]
        rows.append((template, f"{interiors}", *cells[:-1], f"{spent_ms['all']:.1f}"))
    return markdown(rows)


def memory_table(jobs: Sequence[JobFigures]) -> str:
    """Returns what jobs took."""
    rows = [("worlds", "seconds", "job MB", "worker MB", "stored MB")]
    rows += [
        (f"{job.worlds}", f"{job.seconds:.1f}", f"{job.job_mb:.0f}", f"{job.worker_mb:.0f}", f"{job.stored_mb:.1f}")
        for job in jobs
    ]
    return markdown(rows)


def main() -> None:
    """Prints the tables."""
    parser = options(__doc__)
    parser.add_argument("--quick", action="store_true", help="three short repeats, and no job of 10,000 worlds")
    parser.add_argument("--quality", action="store_true", help="the quality tables instead")
    parser.add_argument("--seeds", type=int, default=200, help="worlds of each template and density (--quality)")
    given = parser.parse_args()
    if given.quality:
        show("quality", quality_tables(measure_quality(given.seeds)), given.document)
        show("certificate", example_certificate(), given.document)
    else:
        show("speed", _speed(quick=given.quick), given.document)


def _speed(*, quick: bool) -> str:
    jobs = [measure_memory(worlds) for worlds in (_JOBS[:2] if quick else _JOBS)]
    stages = {(name, each): measure_stages(name, each, _STAGE_WORLDS) for name in SPEED_TEMPLATES for each in INTERIORS}
    rates = measure_rates(*((_QUICK_REPEATS, _QUICK_SECONDS) if quick else (_REPEATS, _SECONDS)))
    tables = {
        "Worlds a second, certificate included": speed_table(rates),
        "Milliseconds a world on one core": stage_table(stages),
        "A job in a folder, two processes, ten interiors a plan": memory_table(jobs),
    }
    return "\n\n".join(f"{heading}:\n\n{table}" for heading, table in tables.items())


if __name__ == "__main__":
    main()
