"""The build backend is hatchling. Before pip looks for packages, it is asked here whether Python is new enough.

Without this question, pip on an older Python names the first dependency that it cannot find, and not the reason.
"""

import sys

if sys.version_info < (3, 11):
    sys.exit(
        "\n\ntruearm needs Python 3.11 or newer, and this is Python {}.{}.\n"
        "Remove this environment (.venv) and make it with a newer Python, by its own name: "
        "python3.13 -m venv .venv\n".format(*sys.version_info[:2])
    )


def get_requires_for_build_wheel(config_settings=None):
    """What a build needs, for each kind of build."""
    return ["hatchling>=1.24"]


get_requires_for_build_sdist = get_requires_for_build_wheel


def get_requires_for_build_editable(config_settings=None):
    """An editable install is a file that names the folder, which hatchling writes by another package."""
    return [*get_requires_for_build_wheel(), "editables>=0.3"]


def build_editable(wheel_directory, config_settings=None, metadata_directory=None):
    """An editable install; pip asks whether this hook is there before hatchling is."""
    import hatchling.build

    return hatchling.build.build_editable(wheel_directory, config_settings, metadata_directory)


def __getattr__(hook):
    import hatchling.build

    return getattr(hatchling.build, hook)
