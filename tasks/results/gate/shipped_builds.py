"""What a run ships: which builds of which version, with which variables, and that episodes drove them so.

A version may have a bundle for each architecture, and whoever can write to the store may add one, or say that a robot
has another architecture. So it does not matter which robots there are: each build of the version was driven, or the
document names its digest and the build that was driven in its place.

Episodes give a robot application all variables of its request, those of the scenario among them, and those of the
matrix. Which of them it reads, only the application knows. So all count: what passed at half speed ships at half speed.
Robots get each variable, with a value that episodes had, all of them together; or the document says which do not, and
why.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from pydantic import Field

from specs.base import Fault, Spec
from specs.errors import DocumentError
from specs.field_types import Architecture
from specs.pipeline.document import PipelineSpec
from specs.pipeline.simulation_section import Deployment, UntestedBuild
from specs.robomaker.bundle import Version

_BUILDS = "deployment.untestedBuilds"


class ShippedBuild(Spec):
    """A version's bundle for one architecture.

    Attributes:
        digest: SHA-256 of the bundle.
        tested_as: The architecture whose build was driven in its place, as the document says; None if it was driven.
    """

    architecture: Architecture
    digest: str
    tested_as: Architecture | None = None


class Shipment(Spec):
    """What a run ships if its gate passes; settled before anything runs.

    Attributes:
        application: The robot application.
        version: Its version's number.
        digest: SHA-256 of the version's bundle; of several, of the one for X86_64.
        builds: The bundle for each architecture; none where one is for all of them.
        variables: The variables of the launch configuration that episodes had with the same value.
        untested: Why a variable is not as in any episode, by name: the document's words.
    """

    application: str
    version: int
    digest: str
    builds: tuple[ShippedBuild, ...] = ()
    variables: dict[str, str] = Field(default_factory=dict)
    untested: dict[str, str] = Field(default_factory=dict)

    def digests(self) -> dict[Architecture, str]:
        """Returns the digest of the bundle for each architecture; nothing where one is for all of them."""
        return {build.architecture: build.digest for build in self.builds}


def shipment_of(section: Deployment, version: Version) -> Shipment:
    """Returns what a section ships of a version, as the document tells it.

    Args:
        section: The document's section.
        version: What it deploys.
    """
    named, untested = section.untestedBuilds or {}, section.untestedVariables or {}
    given = section.deploymentApplicationConfigs[0].launchConfig.environmentVariables or {}
    return Shipment(
        application=version.name,
        version=version.number,
        digest=version.digest,
        builds=tuple(
            ShippedBuild(architecture=each, digest=digest, tested_as=named[each].testedAs if each in named else None)
            for each, digest in version.digests.items()
        ),
        variables={name: value for name, value in given.items() if name not in untested},
        untested=dict(untested),
    )


def build_faults(version: Version, named: Mapping[Architecture, UntestedBuild], driven: Collection[str]) -> list[Fault]:
    """Returns a fault for each build that nothing stands for, and for each that the document names without need.

    Args:
        version: What is deployed.
        named: The builds that the document says no episode drives, by architecture.
        driven: SHA-256 of each robot application that the batch tests.
    """
    tested = [each for each, digest in version.digests.items() if digest in driven]
    faults = [
        fault
        for each, digest in version.digests.items()
        for fault in _build_faults(version, each, digest, named.get(each), tested)
    ]
    what = f"{version.name} version {version.number}"
    has = f"of {what}: {', '.join(version.digests)}" if version.builds else f"none: {what} has one bundle for all"
    others = [each for each in named if each not in version.digests]
    return [*faults, *(Fault(path=_BUILDS, value=each, allowed=f"an architecture {has}") for each in others)]


def _build_faults(
    version: Version, architecture: Architecture, digest: str, named: UntestedBuild | None, tested: Sequence[str]
) -> Iterator[Fault]:
    what, place = f"{version.name} version {version.number}", f"{_BUILDS}.{architecture}"
    if architecture in tested:
        if named:
            yield Fault(path=place, value=named.digest, allowed="no entry: the batch drives exactly this build")
    elif named is None:
        value = f"the build of {what} for {architecture}, {digest}, which no episode drives"
        allowed = (
            f"a build that the batch drives, by a request whose robotApplications have architecture: {architecture}; "
            f"or {_BUILDS}: {{{architecture}: {{testedAs: {' or '.join(tested)}, digest: ...}}}}, with the digest that "
            "simyard app publish printed; or a version without it"
        )
        yield Fault(path=_BUILDS, value=value, allowed=allowed)
    elif named.digest != digest:
        allowed = f"the build of {what} for {architecture}, which is {digest} in the store; ask who published it"
        yield Fault(path=f"{place}.digest", value=named.digest, allowed=allowed)
    elif named.testedAs not in tested:
        allowed = f"an architecture of {what} whose build the batch drives: {', '.join(tested) or 'none'}"
        yield Fault(path=f"{place}.testedAs", value=named.testedAs, allowed=allowed)


def version_changes(ships: Shipment, version: Version) -> Iterator[str]:
    """Yields what of a version is not as it was when the run began, a line each.

    Args:
        ships: What the run ships.
        version: The version as the store has it now.
    """
    now = {"": version.digest, **version.digests}
    then = {"": ships.digest, **ships.digests()}
    for each in dict.fromkeys([*then, *now]):
        if now.get(each) != then.get(each):
            what = f"{ships.application} version {ships.version}{f' for {each}' if each else ''}"
            yield f"{what} is {now.get(each, 'gone')} now; when the run began it was {then.get(each, 'not there')}"


def shipment_lines(ships: Shipment) -> Iterator[str]:
    """Yields what is shipped under a gate, and what of it no episode drives, for a person."""
    what = f"{ships.application} version {ships.version}"
    if not ships.builds:
        yield f"{what}, one bundle for all architectures, {ships.digest[:12]}"
    for build in ships.builds:
        line = f"{what} for {build.architecture}, {build.digest[:12]}"
        if build.tested_as:
            yield f"{line}: NOT SIMULATED; the document says that the build for {build.tested_as} stands for it"
        else:
            yield f"{line}: simulated"
    if ships.variables:
        yield f"variables as simulated: {', '.join(f'{name}={value}' for name, value in ships.variables.items())}"
    for name, reason in ships.untested.items():
        yield f"variable {name}: NOT AS SIMULATED; the document says why: {reason}"


def unjudged_lines(ships: Shipment, driven: Collection[str]) -> Iterator[str]:
    """Yields which builds are shipped without a gate, for a person.

    Args:
        ships: What is shipped.
        driven: SHA-256 of each robot application that the document's batch drives.
    """
    for build in ships.builds:
        simulated = "simulated" if build.digest in driven else "not simulated, and no gate asks"
        yield f"{ships.application} version {ships.version} for {build.architecture}, {build.digest[:12]}: {simulated}"


Driven = Mapping[str, Sequence[str]]
"""The values that each variable took in some episodes that drove every combination of them."""

_VARIABLES = "deployment.deploymentApplicationConfigs[0].launchConfig.environmentVariables"
_UNTESTED = "deployment.untestedVariables"
_VALUES_SHOWN = 8


def variable_faults(
    given: Mapping[str, str], driven: Iterable[Sequence[Driven]], named: Mapping[str, str]
) -> list[Fault]:
    """Returns a fault for each variable that differs and is not named, and for each that is named without need.

    Compared is with those episodes of each build that differ least.

    Args:
        given: The variables of the deployment's launch configuration.
        driven: What the episodes of each build that is deployed had.
        named: Why a variable differs, by name, as the document says.
    """
    nearest = _nearest(given, driven, named)
    differing = {name for had in nearest for name in _differing(given, had)} if nearest else set(named)
    unnamed = {name: [value for had in nearest for value in had.get(name, ())] for name in differing - named.keys()}
    return [
        *(_variable_fault(name, given.get(name), list(dict.fromkeys(unnamed[name]))) for name in sorted(unnamed)),
        *(
            Fault(path=f"{_UNTESTED}.{name}", value=repr(reason), allowed="no entry: robots get it as episodes do")
            for name, reason in named.items()
            if name not in differing
        ),
    ]


def check_variables(spec: PipelineSpec, base: Path) -> None:  # noqa: ARG001 - as every check of a document
    """Refuses variables of a deployment that no request of the document drives, as far as no store is needed for it.

    Where a request drives another application than the deployed one, or requests drive builds for several
    architectures, only digests tell what is deployed of it, which a plan knows.

    Raises:
        DocumentError: With a fault for each.
    """
    batch, section = spec.simulationBatch, spec.deployment
    if not (spec.gate and batch and section):
        return
    use = section.deploymentApplicationConfigs[0]
    driven, architectures = list[Driven](), set[Architecture | None]()
    for request in batch.createSimulationJobRequests:
        robot = next(iter(request.robotApplications or ()), None)
        if robot is None or (robot.application, robot.applicationVersion) != (use.application, use.applicationVersion):
            return
        architectures.add(robot.architecture)
        uses = [*(request.simulationApplications or ()), robot]
        own = {name: value for each in uses for name, value in (each.launchConfig.environmentVariables or {}).items()}
        driven.append({**{name: (value,) for name, value in own.items()}, **batch.matrix.environmentVariables})
    given = use.launchConfig.environmentVariables or {}
    if len(architectures) > 1:
        return
    if faults := variable_faults(given, [driven], section.untestedVariables or {}):
        raise DocumentError(faults)


def differing_names(given: Mapping[str, str], driven: Iterable[Sequence[Driven]]) -> list[str]:
    """Returns the variables that differ from what episodes had; arguments as there."""
    return sorted({name for had in _nearest(given, driven, ()) for name in _differing(given, had)})


def _nearest(given: Mapping[str, str], driven: Iterable[Sequence[Driven]], named: Iterable[str]) -> list[Driven]:
    expected = set(named)
    return [min(each, key=lambda had: len(_differing(given, had) ^ expected)) for each in driven if each]


def _differing(given: Mapping[str, str], had: Driven) -> set[str]:
    return {name for name in {*given, *had} if given.get(name) not in had.get(name, ())}


def _variable_fault(name: str, given: str | None, values: Sequence[str]) -> Fault:
    shown = ", ".join(map(repr, values[:_VALUES_SHOWN])) + (", ..." if len(values) > _VALUES_SHOWN else "")
    allowed = f"a value that simulationBatch drives: {shown}" if values else "not set: simulationBatch does not set it"
    value = "not set" if given is None else repr(given)
    return Fault(path=f"{_VARIABLES}.{name}", value=value, allowed=f"{allowed}; or {_UNTESTED}.{name}, with the reason")
