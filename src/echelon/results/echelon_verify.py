"""Check a saved set of base parameters with this file, Python, and integers modulo random primes; nothing else.

    python echelon_verify.py set.json        exit codes: 0 valid, 1 NOT valid, 2 not readable, 3 not covered here

The virtual work of the outputs is Σ m δx·(a − g) over all particles; a particle p of a body is at H (p, 1), so a body adds
tr(δH J (Ḧ − G)ᵀ), where J = ∫ (p, 1)(p, 1)ᵀ dm is linear in its ten parameters and g the last column of G.  Each step of
a joint is a matrix S with Ṡ = S W and δS = S U; a sensor is a step that only moves virtually.  An angle u is a random e^(iu)
modulo a prime, a sign a random number.  docs/verification.md says why this is enough, and bounds the error.
"""
import ast, json, math, re, secrets, sys
from collections import defaultdict
from fractions import Fraction
from operator import add, mul, neg, sub, truediv
OPERATIONS = {ast.Add: add, ast.Sub: sub, ast.Mult: mul, ast.Div: truediv, ast.USub: neg, ast.Pow: pow}
KEYS = "schema echelon name seed rank outputs parameters order base classification reading special generic certificate largest_coefficient"
RANDOM, ONE, ZERO = secrets.SystemRandom(), [[int(i == j) for j in range(4)] for i in range(4)], [[0] * 4] * 4
AXES, FINEST_ANGLE, NUMBER = ((0, "X"), (1, "Y"), (2, "Z")), Fraction(1, 10**24), r"[0-9.]{1,400}(e[-+]?[0-9]{1,2})?"
MOMENTS = {a + a: {(k, k): Fraction(1 - 2 * (k == i), 2) for k in range(3)} for i, a in AXES}  # J for a unit of each
MOMENTS |= {a + b: {(i, j): -1, (j, i): -1} for i, a in AXES for j, b in AXES if i < j}
MOMENTS |= {"M" + a: {(i, 3): 1, (3, i): 1} for i, a in AXES} | {"M": {(3, 3): 1}}

def need(condition, problem):
    if not condition: raise AssertionError(problem)  # the set is not valid
def cover(condition, what):
    if not condition: raise NotImplementedError(what)  # the set may be valid
def only(data, keys):  # one that is not known here may change what the others mean
    cover(data.keys() <= {*keys.split()}, "closed loops" if "loops" in data else ", ".join(sorted({*data} - {*keys.split()})))
    return data
def unique(pairs):
    need(len(dict(pairs)) == len(pairs), "a name stands twice")
    return dict(pairs)

def random_prime():
    """A prime of 81 bits that is 25 modulo 48; the strong test is a proof below 3.3e24 (Sorenson and Webster, 2015)."""
    while True:
        p = 2**80 + 9 + 48 * RANDOM.randrange(2**80 // 48)  # 2^80 is 16 modulo 48, and (p − 1)/8 is odd
        powers = ([pow(a, p // k, p) for k in (8, 4, 2)] for a in (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41))
        if all(x[0] == 1 or p - 1 in x for x in powers): return p
def cross(a, b): return [a[i - 2] * b[i - 1] - a[i - 1] * b[i - 2] for i in range(3)]
def twist(turn, slide=(0, 0, 0), rate=1):
    """The 4 × 4 matrix of an angular and a linear velocity, times a rate."""
    columns = [*(cross(turn, axis[:3]) for axis in ONE[:3]), slide]
    return [[column[i] * rate for column in columns] for i in range(3)] + [ZERO[0]]

class Robot:
    """A saved model modulo a random prime p, with stated or random values of its symbols, and rows uᵀX at random states."""
    def __init__(self, model, at_values):
        self.p, self.largest_power, self.angles = random_prime(), 1, defaultdict(self.random)
        roots = (pow(self.random(), self.p // 24, self.p) for _ in iter(int, 1))
        self.root = w = next(w for w in roots if pow(w, 12, self.p) == self.p - 1 and pow(w, 8, self.p) != 1)  # 15°
        root2, root3 = (pow(w, n, self.p) + pow(w, -n, self.p) for n in (3, 2))
        self.known = {"sqrt(2)": root2, "sqrt(3)": root3, "sqrt(6)": root2 * root3}
        values = {n: entry.get("value") if isinstance(entry, dict) else entry for n, entry in model.get("symbols", {}).items()}
        self.stated = {name: text for name, text in values.items() if text is not None and at_values}
        self.coordinates(model)
    def random(self): return RANDOM.randrange(1, self.p)
    def residue(self, x): return x.numerator * pow(x.denominator, -1, self.p) % self.p
    def read(self, text): return self.residue(self.evaluate(text, self.look_up))
    def products(self, *matrices):  # the sum A B + C D + ... for A, B, C, D, ...
        rows = [[x for row in rows for x in row] for rows in zip(*matrices[::2], strict=True)]
        columns = list(zip(*(row for matrix in matrices[1::2] for row in matrix), strict=True))
        return [[sum(map(mul, row, column)) % self.p for column in columns] for row in rows]
    def reduced(self, rows):  # rows of the reduced echelon form by pivot column
        def without(row, k, lead): return [(x - row[k] * y) % self.p for x, y in zip(row, lead, strict=True)]
        found = {}
        for row in rows:
            for k, lead in found.items(): row = without(row, k, lead)
            if any(row):
                n, inverse = next((n, pow(x, -1, self.p)) for n, x in enumerate(row) if x)
                row = [x * inverse % self.p for x in row]
                found = {k: without(lead, n, row) for k, lead in found.items()} | {n: row}
        return found
    def cosine_sine(self, *powers):  # of the sum of n u over pairs of z = e^(iu) and n
        self.largest_power = max(self.largest_power, sum(abs(n) for _, n in powers))
        a, b = (math.prod(pow(z, sign * n, self.p) for z, n in powers) for sign in (1, -1))
        return self.residue(Fraction(a + b, 2)), self.residue(Fraction(a - b, 2 * pow(self.root, 6, self.p)))
    def angle(self, name):  # e^(iu) of a symbol u: at its stated value a multiple of 15° plus one of the finest angle
        if name not in self.stated: return self.angles[name]
        decimal, turn = (self.evaluate(self.stated[name], {"pi": Fraction(pi)}.__getitem__) for pi in (0, 12))
        steps, fine = turn - decimal, decimal / FINEST_ANGLE
        cover(steps.denominator == fine.denominator == 1, f"the angle {self.stated[name]!r}")
        return pow(self.root, int(steps), self.p) * pow(self.angles[FINEST_ANGLE], int(fine), self.p)
    def evaluate(self, text, look_up):  # an expression by Python's grammar; names, calls, entries [...] are looked up
        text = text.strip(" ").replace("^", "**")
        def value(node):
            source = ast.get_source_segment(text, node)
            if isinstance(node, ast.Name | ast.Call | ast.Subscript): return look_up(source)
            if isinstance(node, ast.Constant) and re.fullmatch(NUMBER, source): return Fraction(source)
            operands = [value(getattr(node, part)) for part in ("left", "operand", "right") if hasattr(node, part)]
            power = source.count("**") == 1 and operands[-1] in range(-16, 17)  # powers of powers are not in the bound
            cover(operands and type(node.op) in OPERATIONS and (power or not isinstance(node.op, ast.Pow)), f"{source[:60]!r}")
            return OPERATIONS[type(node.op)](*operands)
        return value(ast.parse(text, mode="eval").body)
    def look_up(self, text):  # the value of a symbol, root, sine or cosine
        call = re.fullmatch(r"(cos|sin)\((?:([0-9]{1,9})\*)?(\w+)\)", text)
        if text not in self.known and call:
            self.known[text] = self.cosine_sine((self.angle(call[3]), int(call[2] or 1)))[call[1] == "sin"]
        elif text not in self.known:
            cover(text.isidentifier() and (text != "pi" or not self.stated), f"{text[:60]!r}")
            self.known[text] = self.read(self.stated[text]) if text in self.stated else self.random()
        return Fraction(self.known[text])
    def coordinates(self, model):  # free coordinates, what depends on them, and outputs
        self.model = only(model, "echelon name symbols gravity couplings actuators effects outputs bodies")
        gravity = {"none": "000", "generic": ["gx", "gy", "gz"]}.get(str(model["gravity"]), model["gravity"])
        self.gravity = [[0, 0, 0, self.read(g)] for g in gravity] + [ZERO[0]]
        steps = [step for body in model["bodies"] for step in only(body["joint"], "type kind name steps")["steps"]]
        motions = unique([(step["name"], step["motion"]) for step in steps if "motion" in step])
        followers = unique([item for entry in model.get("couplings", []) for item in entry.items()])
        actuators = self.actuators = model.get("actuators", {})
        axes = {name: [f"{name}.{c}" for c in "xyz"] if kind == "ball" else [name] for name, kind in motions.items()}
        self.balls = {axis for name in axes for axis in axes[name] if axis != name}
        self.free = [axis for name in axes if name not in followers for axis in axes[name]]
        self.ratios, self.symbolic = {x: {x: Fraction(1)} for x in self.free}, set()
        for name, entry in [*followers.items(), *actuators.items()]:
            terms = only(entry, "terms")["terms"]
            linear = {*terms} <= {*self.free} and {*map(type, terms.values())} <= {str}
            cover(linear and name not in self.ratios, f"how {name!r} depends on others")
            self.ratios[name] = {x: self.evaluate(ratio, self.look_up) for x, ratio in terms.items()}
            if not re.fullmatch("[-+*/(). 0-9e]*", "".join(terms.values())): self.symbolic.add(name)
        cover(all(motions[n] == "translation" for n in {*followers} & self.symbolic), "an angle with a ratio that is a symbol")
        self.part = math.lcm(*(r.denominator for terms in self.ratios.values() for r in terms.values()))  # of an angle
        self.driven = [x for x in self.free if any(x in self.ratios[a] for a in actuators)]
        self.drives = [*actuators, *(x for x in self.free if x not in self.driven)]
        self.outputs = unique([self.output(e) for e in model.get("outputs", [{"actuator": n, "name": n} for n in self.drives])])
    def frame(self, data):
        R = [[self.read(x) for x in row] for row in only(data, "xyz rotation").get("rotation", ("100", "010", "001"))]
        x, y, z = zip(*R, strict=True)
        need(self.products([x, y, z, cross(x, y)], R) == [row[:3] for row in [*ONE[:3], ONE[2]]], "a matrix that is not a rotation")
        return [[*row, self.read(t)] for row, t in zip(R, data.get("xyz", "000"), strict=True)] + [ONE[3]]
    def output(self, entry):  # the name of an output, and weights of the displacements along which it measures
        only(entry, "name unit sum joint actuator wrench frame fixed_to components")
        if "wrench" not in entry:
            terms = [("joint" if "joint" in t else "actuator", t) for t in entry.get("sum", [entry])]
            cover(all(t[side] in (self.free if side == "joint" else self.drives) for side, t in terms), "a sensor there")
            return entry["name"], unique([((side, t[side]), self.read(t.get("weight", "1"))) for side, t in terms])
        frame, ((kind, letter),), place = self.frame(entry["frame"]), entry["components"], entry["wrench"]
        cover((place == "base") + [body["name"] for body in self.model["bodies"]].count(place) == 1, f"a sensor at {place!r}")
        *axis, _ = [row["xyz".index(letter)] for row in frame]
        motion = [*axis, *cross([row[3] for row in frame], axis)] if kind == "t" else [0, 0, 0, *axis]
        place = place != "base" and place, entry["fixed_to"]
        return f"{entry['name']}.{kind}{letter}", {(*place, k): x for k, x in enumerate(motion)}
    def draw(self):  # a new state, and a virtual displacement along the outputs
        along = self.along = defaultdict(int)
        for weights, u in [(weights, self.random()) for weights in self.outputs.values()]:
            for place, weight in weights.items(): along[place] += u * weight
        rows = [[*(self.ratios[a].get(x, 0) for x in self.driven), along["actuator", a]] for a in self.actuators]
        solved = self.reduced([[self.residue(x) for x in row] for row in rows])
        cover([*range(len(rows))] == [*range(len(self.driven))] == sorted(solved), "drives that leave joints open")
        moved = {x: along["actuator", x] for x in self.free} | {x: solved[k][-1] for k, x in enumerate(self.driven)}
        self.signs, currents = defaultdict(self.random), {f"i[{name}]": self.random() for name in self.ratios}
        self.angles, self.known = self.angles | {("joint", x): self.random() for x in self.free}, self.known | currents
        for kind in ("q", "qd", "qdd", "virtual!"):
            now = {x: along["joint", x] + moved[x] if kind == "virtual!" else self.random() for x in self.free}
            allowed = {n: r for n, r in self.ratios.items() if kind != "q" or not self.balls & r.keys()}  # a ball has no position
            for name, ratios in allowed.items():
                self.known[f"{kind}[{name}]"] = self.residue(sum(ratio * now[x] for x, ratio in ratios.items()))
    def step(self, data):  # S, W, Ẇ and U of a frame or an elementary motion
        if "motion" not in data: return self.frame(data), ZERO, ZERO, ZERO
        kind, name, letters = only(data, "motion name axis pitch")["motion"], data["name"], data["axis"]
        cover(kind in ("rotation", "translation", "screw", "ball"), f"a {kind!r}")
        axis = [(x == letters[-1]) * (-1 if letters[0] == "-" else 1) for x in "xyz"]
        turn, slide, at, rates = axis if kind != "translation" else [0, 0, 0], [0, 0, 0], 0, ("qd", "qdd", "virtual!")
        if kind == "ball":  # any rotation is 1 + 2 (K + K²) / (1 + |e|²), where K x = e × x (Cayley)
            turn = [self.random() for _ in range(3)]
            s = self.residue(Fraction(2, 1 + sum(map(mul, turn, turn))))
            c, twists = 1 - s, [twist([self.known[f"{rate}[{name}.{x}]"] for x in "xyz"]) for rate in rates]
        else:
            slide = [x * (self.read(data["pitch"]) if kind == "screw" else kind == "translation") for x in axis]
            terms = self.ratios[name].items() if any(turn) else ()
            c, s = self.cosine_sine(*((self.angles["joint", x], int(ratio * self.part)) for x, ratio in terms))
            at, twists = self.known[f"q[{name}]"], [twist(turn, slide, self.known[f"{rate}[{name}]"]) for rate in rates]
        S = self.products(ONE, ONE, twist(turn, rate=s), ONE, twist(turn, rate=1 - c), twist(turn))
        return [[*row[:3], x * at] for row, x in zip(S, slide, strict=False)] + [ONE[3]], *twists
    def row(self):  # the entries of uᵀX at a new state, by parameter
        self.draw()
        row, placed, times = defaultdict(int), {}, self.products  # bodies with one label share their parameters
        for body in [{"name": False, "joint": {"steps": []}, "massless": True}, *self.model["bodies"]]:
            only(body, "name label parent joint massless parameters separate inertial")
            H, V, A, D = placed[body.get("parent", False)] if placed else (ONE, ZERO, ZERO, ZERO)  # H, Ḣ, Ḧ, δH
            sensed = ([self.along[body["name"], side, k] for k in range(6)] for side in ("parent", "body"))
            before, after = ((ONE, ZERO, ZERO, twist(along[:3], along[3:])) for along in sensed)
            for S, W, dW, U in [before, *map(self.step, body["joint"]["steps"]), after]:
                dS = times(S, W)
                D, A = times(D, S, H, times(S, U)), times(A, S, V, dS, V, dS, H, times(dS, W, S, dW))
                V, H = times(V, S, H, dS), times(H, S)
            cover(body["name"] not in placed, "bodies of one name")
            placed[body["name"]] = H, V, A, D
            Q = times(list(zip(*D, strict=True)), [list(map(sub, a, g)) for a, g in zip(A, self.gravity, strict=True)])
            kinds = unique([(k, MOMENTS[k].items()) for k in ([] if body.get("massless") else body.get("parameters", MOMENTS))])
            for kind, J in kinds.items(): row[kind, body["label"]] += self.residue(sum(x * Q[i][j] for (i, j), x in J))
        effects = [(effect["parameter"], self.effect(effect)) for effect in self.model.get("effects", [])]
        return unique([*((kind + label, x) for (kind, label), x in row.items()), *effects])
    def effect(self, entry):  # the virtual work of an effect
        total = Fraction(0)
        for act in only(entry, "parameter unit acts value")["acts"]:
            at = only(act, "at side term")["at"]
            cover(at in {"joint": self.ratios, "actuator": self.drives}[act["side"]], f"an effect at {at!r}")
            term = re.sub(r"(?<![\w\[])(qdd|qd|q|i)(?![\w\[])", rf"\1[{at!r}]", act["term"])
            one, two, three = (self.evaluate(term, lambda text, n=n: self.of_state(text, n)) for n in (1, 2, 3))
            cover(not self.residue(one + three - 2 * two), f"products of signs: {act['term'][:60]!r}")
            total += one * (self.known[f"virtual![{at}]"] if act["side"] == "joint" else self.along["actuator", at])
        return self.residue(total)
    def of_state(self, text, scale):  # of an effect; signs are scaled, which shows if a term is linear in them
        found = re.fullmatch(r"(sign|abs)\((.*)\)", text := re.sub("""["']""", "", text))
        if not found: return self.look_up(text)
        value, combination = self.residue(self.evaluate(found[2], self.look_up)), {}
        for kind, x in [(kind, x) for kind in ("q", "qd", "qdd") for x in self.free]:  # where only this one is not 0
            rational = {f"{kind}[{name}]": terms.get(x, 0) for name, terms in self.ratios.items() if name not in self.symbolic}
            ratio = self.evaluate(found[2], lambda name, rational=rational: Fraction(rational.get(name, 0)))
            combination |= {f"{kind}[{x}]": ratio} if ratio else {}
        value_again = self.residue(sum(ratio * self.known[name] for name, ratio in combination.items()))
        cover(combination and value == value_again, f"the sign of {found[2][:60]!r}")
        lead = next(iter(combination.values()))  # proportional ones have one sign, or opposite ones
        sign = self.signs[*((name, ratio / lead) for name, ratio in combination.items())] * (1 if lead > 0 else -1)
        return Fraction(scale * sign * (value if found[1] == "abs" else 1))

def verify(data):
    """What was found, in a sentence."""
    own, rounds, log_error = Robot(only(data, KEYS + " model")["model"], data["generic"] is False), 0, 0
    row, pivots = own.row(), [base["name"] for base in data["base"]]
    known = (data["schema"], data["model"]["echelon"]) == ("echelon.base-model/1", 1) and isinstance(data["generic"], bool)
    cover(known, "this schema")
    need(sorted(data["parameters"]) == sorted(data["order"]) == sorted(row), "its parameters are not those of its model")
    need(data["outputs"] == [*own.outputs] and data["rank"] == len({*pivots} & {*row}) == len(pivots), "its outputs or its rank are others")
    terms = [(base["name"], only(t, "parameter coefficient denominator value")) for base in data["base"] for t in base["terms"]]
    while log_error > -30 * math.log(10):
        robot = Robot(data["model"], False)
        left = dict(row := robot.row())
        for pivot, t in terms:
            left[t["parameter"]] -= row[pivot] * robot.read(t["coefficient"]) * pow(robot.read(t.get("denominator", "1")), -1, robot.p)
        wrong = [name for name in left if left[name] % robot.p]
        need(not wrong, f"it is not complete: it does not reproduce the effect of {wrong[:4]}")
        size = 128 * robot.largest_power * len(json.dumps([data["model"], terms]))
        cover(size < 2**60, "such large multiples of an angle")
        rounds, log_error = rounds + 1, log_error + math.log(size / 2**80 + 8 * 16 * size / 80 / 2**70)
    rank = len(own.reduced([[row[name] for name in pivots] for row in (own.row() for _ in range(len(pivots) + 4))]))
    need(rank == len(pivots), f"it is not minimal: of its {len(pivots)} rows only {rank} are independent")
    return (f"valid: {rank} base parameters of {len(row)}, minimal by a minor, complete modulo {rounds} primes of 81 bits, "
            f"error probability below 1e{math.ceil(log_error / math.log(10))}")

def judge(text: str | bytes) -> tuple[int, str]:  # the exit code and a sentence for the text of a file
    try: return 0, verify(json.loads(text, object_pairs_hook=unique))
    except AssertionError as problem: return 1, f"NOT valid: {problem}"
    except (NotImplementedError, RecursionError, MemoryError) as what: return 3, f"NOT checked: not covered here: {what}"
    except (ArithmeticError, AttributeError, LookupError, SyntaxError, TypeError, ValueError) as error:
        return 2, f"not readable: {type(error).__name__}: {error}"

if __name__ == "__main__":
    code, sentence = judge(open(sys.argv[1], "rb").read())
    sys.exit(print(sentence) or code)
