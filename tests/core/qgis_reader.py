"""What QGIS makes of a raster, as JSON; run by the Python that QGIS is installed for.

python3 qgis_reader.py RASTER
"""

import json
import os
import sys


def main(path: str) -> None:
    """Print what a layer of the raster says, and the values of its first band."""
    os.environ["QT_QPA_PLATFORM"] = "offscreen"
    from qgis.core import QgsApplication, QgsRasterLayer  # type: ignore[import-not-found]

    application = QgsApplication([], False)
    application.initQgis()
    layer = QgsRasterLayer(path, "raster", "gdal")
    provider = layer.dataProvider()
    extent = layer.extent()
    block = provider.block(1, extent, layer.width(), layer.height())
    found = {
        "valid": layer.isValid(),
        "crs": layer.crs().authid(),
        "shape": [layer.height(), layer.width()],
        "bands": layer.bandCount(),
        "name": layer.bandName(1),
        "bounds": [extent.xMinimum(), extent.yMinimum(), extent.xMaximum(), extent.yMaximum()],
        "degrees": "degree" in provider.htmlMetadata(),
        "values": [
            [
                None if block.isNoData(row, column) else block.value(row, column)
                for column in range(layer.width())
            ]
            for row in range(layer.height())
        ],
    }
    print(json.dumps(found), flush=True)
    os._exit(0)  # taking QGIS down without a display may fail, and all is said


if __name__ == "__main__":
    main(sys.argv[1])
