"""Environment variables of an application on a robot: fixed ones, the launch configuration's, and tags."""

import re
from collections.abc import Iterable, Mapping

from specs.base import Fault

TAG_PREFIX = "AWS_ROBOMAKER_ROBOT_TAG_KEY_"
BASE_VARIABLES: Mapping[str, str] = {
    "PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin",
    "LANG": "C.UTF-8",
}
ALLOWED = "no variable that changes which code a shell, loader or interpreter runs, and none of Simyard's own"
# The loader, the shell and interpreters take code from these.
_REFUSED = re.compile(
    r"(LD|DYLD|PYTHON|PERL|RUBY|NODE|JAVA|GCONV|GLIBC|MALLOC|BASH|SIMYARD)_.*|PYTHON.*|PERL5.*|RUBY.*"
    r"|PATH|ENV|IFS|PS4|HOME|SHELLOPTS|BASHOPTS|CLASSPATH|JAVA_TOOL_OPTIONS|LOCPATH|NLSPATH|HOSTALIASES|PROMPT_COMMAND"
)


def environment(
    variables: Mapping[str, str], robot_tags: Mapping[str, str], deployment_tags: Mapping[str, str]
) -> dict[str, str]:
    """Returns what a configuration and tags add to `BASE_VARIABLES`; a deployment's tag wins over its robot's.

    See docs/reference/robomaker.md, section 9.
    """
    tags = {f"{TAG_PREFIX}{key}": value for key, value in {**robot_tags, **deployment_tags}.items()}
    return {**variables, **tags}


def variable_faults(names: Iterable[str], path: str) -> list[Fault]:
    """Returns a fault for each variable that a document may not set; ``path`` is where the document has them."""
    return [Fault(path=f"{path}.{name}", value=name, allowed=ALLOWED) for name in names if _REFUSED.fullmatch(name)]
