"""Connected arms and instruments: each source is an iterator of samples, in a file named after its protocol."""

from truearm.wings.bench.sources.sample import Notice, Sample, Source
from truearm.wings.bench.sources.source_names import open_source
from truearm.wings.bench.sources.standstill import StandstillRule

__all__ = ["Notice", "Sample", "Source", "StandstillRule", "open_source"]
