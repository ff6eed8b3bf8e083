"""The commands `simyard up` and `down`, a Prefect server that stays, and `simyard worker`, which works off a queue."""
# ruff: noqa: PLC0415 - imports when it runs, so that `--help` loads little

from typing import Annotated

import typer

from flows.cli.output import echo

PoolOption = Annotated[
    str,
    typer.Option(
        "--pool",
        metavar="NAME",
        help="Hand each job to this work pool of the Prefect server that stays, instead of doing it here.",
        show_default=False,
    ),
]


def up() -> None:
    """Start a Prefect server that stays; `simyard run` uses it, and `eval "$(simyard up)"` lets `prefect` use it."""
    import shlex

    from flows.server.prefect_server import prefect_home
    from tasks.server.password import password_file
    from tasks.server.resident import keep

    home = prefect_home()
    server, password = keep(home), shlex.quote(str(password_file(home)))
    if server.notice:
        echo(server.notice, err=True)
    # A shell takes all of it: eval "$(simyard up)"
    echo(f"# Prefect: {server.api_url.removesuffix('/api')}  (log: {server.log})")
    echo(f"# its pages ask for the password in {password}")
    echo(f"export PREFECT_API_URL={server.api_url}")
    echo(f'export PREFECT_API_AUTH_STRING="$(cat {password})"')


def down() -> None:
    """End the server that `simyard up` started."""
    from flows.server.prefect_server import prefect_home
    from tasks.server.resident import end_kept

    server = end_kept(prefect_home())
    echo(f"ended {server.api_url}" if server else "no server was running")


def worker(
    *,
    workers: Annotated[
        int, typer.Option("--workers", metavar="N", min=1, help="So many batches, and so many jobs of worlds, at once.")
    ] = 1,
    pool: PoolOption = "",
    store: Annotated[
        str | None,
        typer.Option("--store", help="file:///folder or s3://bucket/prefix. Default: SIMYARD_STORE, else ./.simyard."),
    ] = None,
) -> None:
    """Work off the jobs that calls of RoboMaker's API have put into a store's queue, until Ctrl-C.

    `simyard serve` has a worker of its own; this is one more, on any machine that reaches the store.
    """
    from flows.queue.foreman import lead, wait_for_ever
    from flows.queue.worker_log import log_to_stderr
    from tasks.storage.store_url import open_store

    opened = open_store(store)
    log_to_stderr()
    lead(opened.url, workers, pool, wait_for_ever)
