"""Names that other rooms may use, and where each is defined."""

from echelon.comparison.comparing import compare as compare
from echelon.comparison.result import Comparison as Comparison
from echelon.comparison.result import Equality as Equality
from echelon.comparison.result import comparison_schema as comparison_schema
