"""Keys are made only where nobody else on the machine can exchange them."""

import shlex

import pytest

from tests.attacks.conftest import Owner


@pytest.mark.parametrize("mode", [0o777, 0o770])
def test_keys_are_not_made_below_a_folder_that_others_can_write(mode: int, owner: Owner) -> None:
    """Waits for keys in a folder that is shared, to exchange them: they are not made there."""
    shared = owner.folder / "shared"
    shared.mkdir()
    shared.chmod(mode)

    done = owner.simyard("fleet", "keys", "init", "--keys", "shared/keys")

    assert done.returncode != 0
    assert f"chmod go-w {shlex.quote(str(shared))}" in done.stdout.replace("\n", "")
    assert not list(shared.rglob("*.pem"))


def test_keys_are_not_made_in_a_folder_that_others_can_write(owner: Owner) -> None:
    """Opens the folder of keys to others before there are any: they are not made there, until it is closed."""
    keys = owner.folder / "keys"
    keys.mkdir()
    keys.chmod(0o775)

    done = owner.simyard("fleet", "keys", "init", "--keys", "keys")

    assert done.returncode != 0
    assert f"chmod go-w {shlex.quote(str(keys))}" in done.stdout.replace("\n", "")
    assert not list(keys.glob("*.pem"))
    keys.chmod(0o755)
    assert owner.simyard("fleet", "keys", "init", "--keys", "keys").returncode == 0


def test_keys_are_made_in_a_folder_where_nobody_renames_what_is_others(owner: Owner) -> None:
    """Shares a folder with the sticky bit, as /tmp: nobody exchanges there what is somebody else's."""
    shared = owner.folder / "shared"
    shared.mkdir()
    shared.chmod(0o1777)

    assert owner.simyard("fleet", "keys", "init", "--keys", "shared/keys").returncode == 0
