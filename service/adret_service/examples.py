"""Examples of the OpenAPI document; a test posts every one of them."""

from typing import Any

__all__ = ["DATASET", "DEPTH", "EXECUTIONS"]

DATASET = "01m83cyackydkes7xvk9d93gn7"  # stands for the id of an uploaded elevation model
DEPTH = "01m83czb6r1t0bq5vn2ks8w4he"  # and this for that of a depth buffer


def _order(summary: str, **order: Any) -> dict[str, Any]:
    return {"summary": summary, "value": order}


EXECUTIONS: dict[str, dict[str, Any]] = {
    "horizon": _order("Horizon map of 16 azimuths", inputs={"dataset": DATASET, "directions": 16}),
    "sky-view": _order(
        "Sky-view factor of sloping ground",
        inputs={"dataset": DATASET, "directions": 16, "kind": "normal"},
    ),
    "openness": _order("Openness", inputs={"dataset": DATASET, "directions": 8}),
    "shadow": _order(
        "Shadow of an evening sun, its picture alone and as it is",
        inputs={"dataset": DATASET, "sun_deg": [290.0, 12.0]},
        outputs={"preview": {"transmissionMode": "value"}},
        response="raw",
    ),
    "light": _order(
        "Sun and a uniform sky, in a document with the picture inside",
        inputs={"dataset": DATASET, "directions": 8, "sky": "uniform", "sun_deg": [315.0, 35.0]},
        outputs={
            "result": {"transmissionMode": "reference"},
            "preview": {"transmissionMode": "value"},
        },
        response="document",
    ),
    "bounce": _order(
        "One bounce of light", inputs={"dataset": DATASET, "directions": 8, "sky": "uniform"}
    ),
    "viewshed": _order(
        "What two observers see", inputs={"dataset": DATASET, "observer": [[10, 12], [30, 40]]}
    ),
    "visibility": _order(
        "How much every cell sees, within 2 km",
        inputs={"dataset": DATASET, "directions": 8, "max_distance": 2000.0},
    ),
    "ssao": _order("Ambient occlusion of a depth buffer", inputs={"dataset": DEPTH}),
}
