"""Exact base inertial parameters of robots, in closed form, with a certificate.

>>> import echelon as ec
>>> robot = ec.load("examples/panda.yaml")
>>> base = ec.base_parameters(robot)
>>> base
BaseModel(panda: 43 base parameters of 70)
"""


def _declared() -> dict[str, str]:
    """Modules by public name, from the lines ``from module import name as name`` of the stub beside this file."""
    stub = __loader__.get_data(
        f"{__file__.removesuffix('c')}i"
    ).decode()  # this file may be there compiled only
    return {
        words[3]: words[1]
        for words in map(str.split, stub.splitlines())
        if words[:1] == ["from"]
    }


_HOME = _declared()

__all__ = sorted(_HOME)


def __getattr__(name: str) -> object:
    """Import a name when it is first asked for, so that no command waits for another's modules."""
    if name not in _HOME:
        raise AttributeError(f"module 'echelon' has no attribute '{name}'")
    from importlib import import_module

    found = globals()[name] = getattr(import_module(_HOME[name]), name)
    return found


def __dir__() -> list[str]:
    return __all__
