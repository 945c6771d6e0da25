"""A hundred jobs and thirty kill -9 at random moments: what became of the jobs.

    python benchmarks/service/storms.py --database postgresql --keep

The storm itself is `tests/chaos/storm.py`, which the tests run in a short form.
"""

import argparse
import json
import sys

from common import DEM, ROOT, record, serving

sys.path.insert(0, str(ROOT / "tests" / "chaos"))

from storm import kill_storm, nothing_wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--database", choices=["sqlite", "postgresql"], default="sqlite")
    parser.add_argument("--jobs", type=int, default=100)
    parser.add_argument("--kills", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", action="store_true", help="Write the results' file.")
    options = parser.parse_args()
    workers = {"ADRET_WORKERS": "2", "ADRET_THREADS_PER_JOB": "1", "ADRET_LIVENESS_GRACE": "0.5"}
    with serving(options.database, **workers) as server:
        account = kill_storm(
            server,
            DEM,
            jobs=options.jobs,
            kills=options.kills,
            seed=options.seed,
            log=lambda line: print(line, file=sys.stderr, flush=True),
        )
    if options.keep:
        record(f"kill-storm-{options.database}", account)
    else:
        print(json.dumps(account, indent=1))
    return 0 if nothing_wrong(account) else 1


if __name__ == "__main__":
    sys.exit(main())
