"""The commands `simyard up` and `down`: a Prefect server that stays."""
# ruff: noqa: PLC0415 - imports when it runs, so that `--help` loads little

from flows.cli.output import echo


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
