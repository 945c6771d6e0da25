"""The OpenAPI document: ``python -m adret_service.openapi [FILE]`` writes it."""

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
    """Write the document to the file named on the command line, or to standard output."""
    if len(sys.argv) > 1:
        Path(sys.argv[1]).write_text(document(), encoding="utf-8")
    else:
        sys.stdout.write(document())


if __name__ == "__main__":
    main()
