"""Pages of a list: the newest first, the next page begins below the last id."""

from collections.abc import Sequence
from typing import Annotated
from urllib.parse import urlencode

from fastapi import Query

__all__ = ["Before", "Limit", "page_links"]

Limit = Annotated[int, Query(ge=1, le=1000, description="Entries a page.")]
Before = Annotated[str | None, Query(max_length=26, description="Only entries older than this id.")]


def page_links(
    url: str, limit: int, ids: list[str], **filters: str | float | Sequence[str] | None
) -> list[dict[str, str]]:
    """Return the links of a page.

    Parameters
    ----------
    url : str
        Absolute URL of the list, without a query.
    limit : int
        Entries a page.
    ids : list of str
        The ids found when one entry more than `limit` was asked for.
    **filters : str, number, sequence of str or None
        Query parameters that the next page keeps.
    """
    kept = {key: value for key, value in filters.items() if value not in (None, [])}
    own = f"{url}?{urlencode({**kept, 'limit': limit}, doseq=True)}"
    links = [{"rel": "self", "type": "application/json", "href": own}]
    if len(ids) > limit:
        query = urlencode({**kept, "limit": limit, "before": ids[limit - 1]}, doseq=True)
        links.append({"rel": "next", "type": "application/json", "href": f"{url}?{query}"})
    return links
