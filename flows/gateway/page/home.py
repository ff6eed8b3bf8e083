"""The first page: what is new in the store."""

from flows.gateway.page.batch_pages import batches_table
from flows.gateway.page.fleet_pages import deployments_table, fleets_table
from flows.gateway.page.run_pages import runs_table
from flows.gateway.page.visit import Visit
from flows.gateway.page.world_pages import worlds_gallery
from tasks.gateway.page.content import GOING, Page

_ROWS, _PICTURES = 5, 4


def home_page(visit: Visit) -> Page:
    """Returns the newest of everything, and where all of it is."""
    tables = (
        batches_table(visit, _ROWS, "/batches"),
        runs_table(visit, _ROWS, "/runs"),
        fleets_table(visit, _ROWS, "/fleets"),
        deployments_table(visit, _ROWS, "/deployments"),
    )
    batches, runs, fleets, deployments = tables
    going = any(cell.is_state and cell.text in GOING for table in tables for row in table.rows for cell in row)
    blocks = (batches, runs, worlds_gallery(visit, _PICTURES, "/worlds"), fleets, deployments)
    return Page("What is new", f"Store {visit.store_id}", blocks=blocks, is_going=going)
