"""Source code of the regressor and of the inverse dynamics, here Python that needs NumPy only.

python examples/08_generate_code.py
"""

from pathlib import Path

import numpy as np

import echelon as ec

base = ec.base_parameters(ec.load(Path(__file__).with_name("double_pendulum.yaml")))

for language in ("c", "python", "matlab"):
    files = ec.generate(base, language, ["regressor"], name="pendulum")
    print(language, {name: len(text.splitlines()) for name, text in files.items()})

module: dict[str, object] = {}
(source,) = (
    text
    for name, text in ec.generate(
        base, "python", ["regressor"], name="pendulum"
    ).items()
)
exec(source, module)  # a program would write the file and import it
q, qd, qdd = np.random.default_rng(2).normal(size=(3, 2))
generated = module["regressor"](q, qd, qdd)  # type: ignore[operator]
print(
    "generated code agrees:",
    np.allclose(generated, base.regressor(q, qd, qdd)),
)
