"""The OpenAPI document: ``python -m adret_service.openapi`` writes it."""

import json
import sys
from pathlib import Path

from adret_service.app import create_app
from adret_service.settings import Settings

__all__ = ["document", "main"]


def document() -> str:
    """Return the document as JSON text, the same for equal code."""
    api = create_app(Settings(data_dir=Path("unused"))).openapi()
    return json.dumps(api, indent=2, sort_keys=True, ensure_ascii=False) + "\n"


def main() -> None:
    """Write the document to the file on the command line, by default into ``openapi/``."""
    target = Path(sys.argv[1] if len(sys.argv) > 1 else "openapi/adret-v1.json")
    target.write_text(document(), encoding="utf-8")


if __name__ == "__main__":
    main()
