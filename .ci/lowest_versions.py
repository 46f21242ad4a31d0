"""Print pip constraints that pin every dependency of the package to the lowest version it allows."""

import re
import tomllib
from pathlib import Path

project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]
for requirement in [
    *project["dependencies"],
    *(
        one
        for extra in ("parquet", "pdf", "sign", "fleet", "live", "mqtt", "opcua")
        for one in project["optional-dependencies"][extra]
    ),
]:
    if bounded := re.fullmatch(r"([\w-]+)>=([\w.]+)(;.*)?", requirement):
        print(f"{bounded[1]}=={bounded[2]}{bounded[3] or ''}")
