"""A saved set is checked again without trusting the file; an altered one is refused.

python examples/05_save_and_verify.py
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import echelon as ec

base = ec.base_parameters(ec.load(Path(__file__).with_name("double_pendulum.yaml")))

with TemporaryDirectory() as folder:
    file = Path(folder) / "base.json"
    ec.save_base(base, file)
    print(ec.verify(file))

    text = file.read_text(encoding="utf-8")
    file.write_text(
        text.replace('"coefficient": "l1^2"', '"coefficient": "2*l1^2"'),
        encoding="utf-8",
    )
    try:
        ec.verify(file)
    except ec.CertificateError as error:
        print("altered:", error)
