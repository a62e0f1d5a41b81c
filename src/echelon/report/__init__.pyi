"""Names that other rooms may use, and where each is defined."""

from echelon.report.calibration import calibration_html as calibration_html
from echelon.report.preview import preview_html as preview_html
from echelon.report.report import report_html as report_html
