"""Commands that judge a file: ``verify`` and ``audit``; and ``schema``, which prints what a file has to be like.

Only typer is imported here; each command imports what it needs when it runs, so that ``--help`` is instant.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from echelon.cli.app import AsJson, Force, Output, Robot, Seed, app, reads_robot
from echelon.cli.screen import json_text, show
from echelon.errors import CertificateError, InputError, one_line

VALID, REFUTED = 0, 1

Schema = Literal["description", "base-model", "identified", "trajectory"]


@app.command(epilog="Example: echelon verify panda.json")
def verify(
    file: Annotated[Path, typer.Argument(help="JSON file written by 'derive --format json'.")],
    as_json: AsJson = False,
    seed: Seed = None,
) -> None:
    """Check a saved set of base parameters again, without trusting what it says about itself."""
    from dataclasses import asdict

    from echelon.results.echelon_verify import judge
    from echelon.results.saved import load_base, verify

    try:
        model = load_base(file)
        certificate = verify(model, seed)
        code, sentence = judge(file.read_bytes())
        if code == REFUTED:
            raise CertificateError(f"the independent verifier says: {sentence}")
    except CertificateError as error:
        refusal = json_text({"valid": False, "reason": str(error)})
        show(refusal if as_json else f"{file}: NOT valid: {one_line(str(error))}")
        raise typer.Exit(REFUTED) from None
    if as_json:
        evidence: dict[str, Any] = asdict(certificate)
        evidence["identity_primes"] = [str(p) for p in certificate.identity_primes]
        independent = {"checked": code == VALID, "says": sentence}
        show(json_text({"valid": True, "rank": certificate.rank, "certificate": evidence, "independent": independent}))
    else:
        show(f"{file}: valid, {model.rank} base parameters of {len(model.parameters)}\n{certificate}")
        show(f"independent verifier: {one_line(sentence)}")


@app.command(epilog="Example: echelon audit tx40.urdf TX40_bp_5.csv --ignore 'fv*'")
@reads_robot("floating", "gravity", "snap_tolerance", "mimic", "keep_fixed_links")
def audit(
    robot: Robot,
    claimed: Annotated[Path, typer.Argument(help="Base parameters to check: CSV, JSON, or one expression per line.")],
    read: dict[str, Any],
    naming: Annotated[
        str, typer.Option(help="How the claims write parameters: 'auto', or echelon, symoro, sympybotics, pinocchio.")
    ] = "auto",
    define: Annotated[
        list[str] | None, typer.Option(help="A symbol of the claims, 'RL4=pz4' or 'L=0.45'; may be repeated.")
    ] = None,
    ignore: Annotated[
        list[str] | None, typer.Option(help="Parameters that the robot file leaves out, 'fv*'; may be repeated.")
    ] = None,
    as_json: AsJson = False,
    output: Output = None,
    force: Force = False,
) -> None:
    """Compare base parameters that someone else claims with the exact ones; exits with 1 where they differ."""
    from echelon.claims.audit import audit
    from echelon.cli.destination import deliver, output_file
    from echelon.formats.robot_file import load

    target, defined = output_file(output, force), _definitions(define or ())
    found = audit(load(robot, **read), claimed, naming=naming, define=defined, ignore=tuple(ignore or ()))
    deliver(json_text(found.to_dict()) if as_json else found.to_text(), target)
    raise typer.Exit(VALID if found.equal else REFUTED)


def _definitions(texts: Sequence[str]) -> dict[str, str]:
    """Symbols of the claims by name, from texts ``NAME=EXPRESSION``."""
    parts = [text.partition("=") for text in texts]
    for text, (name, _, value) in zip(texts, parts, strict=True):
        if not name.strip().isidentifier() or not value.strip():
            raise InputError(f"--define takes NAME=EXPRESSION, such as RL4=pz4 or L=0.45, not '{text}'")
    return {name.strip(): value.strip() for name, _, value in parts}


@app.command(epilog="Example: echelon schema description > robot.schema.json")
def schema(which: Annotated[Schema, typer.Argument(help="Which schema to print.")]) -> None:
    """Print the JSON schema of a file format."""
    from echelon.results.schema import BaseModelRecord, IdentifiedRecord, json_schema

    if which == "description":
        from echelon.formats.schema.robot_schema import json_schema as description_schema

        found = description_schema()
    elif which == "trajectory":
        from echelon.excite.files.coefficients import trajectory_schema

        found = trajectory_schema()
    else:
        found = json_schema(IdentifiedRecord if which == "identified" else BaseModelRecord)
    show(json.dumps(found, indent=2))
