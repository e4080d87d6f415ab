"""Reads metrics files and checks columns, types and what a trial must hold. usage: read_metrics.py FILE..."""

import sys

import polars

for path in sys.argv[1:]:
    frame = polars.read_parquet(path)
    types = {
        "phase": polars.String,
        "step": polars.UInt64,
        "episode": polars.UInt32,
        "seat": polars.UInt32,
        "metric": polars.String,
        "value": polars.Float64,
    }
    assert dict(frame.schema) == types, frame.schema
    final = frame.filter((polars.col("phase") == "final") & (polars.col("metric") == "cycle_length"))
    assert final["episode"].to_list() == sorted(final["episode"].to_list()) or final.height == 4
    assert final.height == 4, final
    assert final["value"].is_finite().all()
    assert frame.filter(polars.col("phase") == "trace")["metric"].n_unique() > 10
    assert polars.read_parquet_metadata(path)["regimen.schema"] == "1"
