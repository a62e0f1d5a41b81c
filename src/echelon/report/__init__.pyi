"""Names that other rooms may use, and where each is defined."""

from echelon.report.preview import preview_html as preview_html
from echelon.report.report import report_html as report_html
