"""Names that other rooms may use, and where each is defined."""

from echelon.codegen.constants import FROM_FILE as FROM_FILE
from echelon.codegen.language import TARGETS as TARGETS
from echelon.codegen.source import Source as Source
from echelon.codegen.source import generate as generate
from echelon.codegen.source import operation_counts as operation_counts
from echelon.codegen.source import operations_text as operations_text
