"""Write the built-in maps anew: ``python tools/make_maps.py``."""

from pytest_rvads.geometry.builtin import LAYOUTS, Roundabout, path_of, roundabout
from pytest_rvads.geometry.opendrive.writer import opendrive


def main() -> None:
    """Write one OpenDRIVE file per built-in layout."""
    for name, layout in LAYOUTS.items():
        path = path_of(name)
        path.parent.mkdir(exist_ok=True)
        text = roundabout(layout, name) if isinstance(layout, Roundabout) else opendrive(layout, name)
        path.write_text(text, encoding="utf-8")
        print(path)


if __name__ == "__main__":
    main()
