"""A roll-out as a step: a plain function of data, which a process calls or Prefect runs as a task."""

from collections.abc import Callable, Collection, Mapping
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from pathlib import Path

from specs.field_types import Architecture
from specs.pipeline.simulation_section import Deployment, LocalFleet
from specs.robomaker.deployment import CreateDeploymentJobRequest
from tasks.deploy.fleet.fleet_registry import create_fleet
from tasks.deploy.kit.local_agents import agent_reserve, local_agents, local_names
from tasks.deploy.rollout.controller import ControllerPace
from tasks.deploy.rollout.deployment_job import run_deployment_job, run_sync_job
from tasks.deploy.trust.signer import DeploymentSigner, chosen_signer
from tasks.deploy.trust.trust_record import chosen_keys
from tasks.progress.listener import stage_progress
from tasks.storage.base.local_files import cache_folder
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord
from tasks.storage.store_url import open_store, store_id

STAGE = "Deployment"
# Robots of this machine end their steps soon, and a wave begins when the last one is seen to have ended.
_LOCAL_POLL_S = 0.05


def roll_out(
    store_url: str,
    request: CreateDeploymentJobRequest,
    section: Deployment,
    *,
    digest: str,
    builds: Mapping[Architecture, str],
    token: str,
) -> JobRecord:
    """Returns the ended deployment job of the token; see `run_deployment_job`.

    Args:
        store_url: Where fleet, robots and versions are.
        request: What to deploy where.
        section: What RoboMaker's request has no words for: rules, trust, and the robots of a demonstration.
        digest: Of the bundle that was tested; the version must be that one.
        builds: Of the bundle for each architecture; the version must have these and no others.
        token: The client request token.
    """
    store = open_store(store_url)
    signer = section_signer(store, section)
    robots = _robots(section, store, signer.root_of_trust if signer else None)
    return run_deployment_job(
        store,
        request,
        digest=digest,
        builds=builds,
        token=token,
        progress=stage_progress(STAGE),
        rules=section.rollOut,
        pace=ControllerPace(poll_s=_LOCAL_POLL_S) if robots else None,
        robots=robots,
        signer=signer,
    )


def deploy_version(
    store_url: str,
    request: CreateDeploymentJobRequest,
    *,
    digest: str,
    builds: Mapping[Architecture, str],
    token: str,
) -> JobRecord:
    """Returns the ended deployment job of a request that no document made; see `run_deployment_job`.

    Args:
        store_url: Where fleet, robots and versions are.
        request: What to deploy where.
        digest: Of the bundle of the version that the request names.
        builds: Of the bundle for each architecture.
        token: The client request token.
    """
    store = open_store(store_url)
    return run_deployment_job(
        store,
        request,
        digest=digest,
        builds=builds,
        token=token,
        progress=stage_progress(STAGE),
        signer=_signer_here(store),
    )


def sync_fleet(store_url: str, fleet: str, *, token: str) -> JobRecord:
    """Returns the ended job that brings a fleet to its latest deployment; see `run_sync_job`.

    Args:
        store_url: Where fleet and robots are.
        fleet: Its name or ARN.
        token: The client request token.
    """
    store = open_store(store_url)
    return run_sync_job(store, fleet, token=token, progress=stage_progress(STAGE), signer=_signer_here(store))


def _signer_here(store: Store) -> DeploymentSigner | None:
    """Returns what signs with the keys that SIMYARD_KEYS names; None without, and robots with a root refuse it."""
    return chosen_signer(store, "signed" if chosen_keys() else "unsigned", local=False)


def section_signer(store: Store, section: Deployment) -> DeploymentSigner | None:
    """Returns what signs a deployment with the keys of this machine; None for an unsigned one.

    Raises:
        DocumentError: There are no keys, and the document asks for them.
    """
    fleet = section.fleet
    return chosen_signer(store, section.trust, local=isinstance(fleet, LocalFleet) and fleet.localAgents > 0)


def agents_folder(store: Store) -> Path:
    """Returns where robots on this machine keep their versions: in the cache, where no writer of the store comes."""
    return cache_folder() / "agents" / store_id(store)


def robot_reserve(store: Store, section: Deployment) -> AbstractContextManager[Callable[[], None]]:
    """Returns a ``with`` block of what begins a demonstration's agents early, for a roll-out that calls them up.

    They are told nothing, and ask no store, before that.
    """
    fleet = section.fleet
    if not isinstance(fleet, LocalFleet) or not fleet.localAgents:
        return nullcontext(lambda: None)
    names, signed = local_names(fleet.name, fleet.localAgents), section.trust == "signed"
    return agent_reserve(store, names, agents_folder(store), signed=signed)


def _robots(
    section: Deployment, store: Store, root_of_trust: Path | None
) -> Callable[[], AbstractContextManager[Collection[str] | None]] | None:
    """Returns what starts the robots of a demonstration once its fleet, made here, is taken; None for real ones."""
    fleet = section.fleet
    if not isinstance(fleet, LocalFleet) or not fleet.localAgents:
        return None
    create_fleet(store, fleet.name)
    folder = agents_folder(store)
    return partial(local_agents, store, fleet.name, fleet.localAgents, folder, root_of_trust=root_of_trust)
