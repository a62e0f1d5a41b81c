"""Check a saved set of base parameters with this file, Python, and integers modulo random primes; nothing else.

    python echelon_verify.py set.json        exit codes: 0 valid, 1 NOT valid, 2 not readable, 3 not covered here

The virtual work of what is measured is Σ m δx·(a − g).  A particle p of a body is at H (p, 1), which a displacement moves by
δH = ξ H with a twist ξ, so a body adds tr(ξ H J (Ḧ − G)ᵀ): J = ∫ (p, 1)(p, 1)ᵀ dm is linear in its ten parameters, g the last
column of G.  An angle u is a random e^(iu) modulo a prime, a sign a random number.  Why that is enough: docs/verification.md.
"""
import ast, functools, json, math, re, secrets, sys
from collections import defaultdict
from fractions import Fraction
from operator import add, mul, neg, sub, truediv
OPERATIONS = {ast.Add: add, ast.Sub: sub, ast.Mult: mul, ast.Div: truediv, ast.USub: neg, ast.Pow: pow}
KEYS = "schema echelon name seed rank outputs parameters order base classification reading special generic certificate"
RANDOM, STATE, ONE = secrets.SystemRandom(), ("q", "qd", "qdd"), [[int(i == j) for j in range(4)] for i in range(4)]
PRIMES, ROOT_OF_1, PARTS_OF_RADIAN = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41), 2 * math.lcm(*range(1, 21), 1000), 10**24
NUMBER, CIRCULAR, ANY = r"[0-9.]{1,400}(e[-+]?[0-9]{1,2})?", r"(cos|sin)\((?:([0-9]{1,9})\*)?(\w+)\)", RANDOM.randrange(2**64)
MOMENTS = {a + a: {(k, k): 1 - 2 * (k == i) for k in range(3)} for i, a in enumerate("XYZ")}  # 2 J for a unit
MOMENTS |= {"XY": {(0, 1): -2, (1, 0): -2}, "XZ": {(0, 2): -2, (2, 0): -2}, "YZ": {(1, 2): -2, (2, 1): -2}, "M": {(3, 3): 2}}
MOMENTS |= {"M" + a: {(i, 3): 2, (3, i): 2} for i, a in enumerate("XYZ")}

def need(condition, problem):
    if not condition: raise AssertionError(problem)  # the set is not valid
def cover(condition, what):
    if not condition: raise NotImplementedError(what)  # the set may be valid
def only(data, keys):  # one that is not known here may change what the others mean
    strange = {*data} - {*keys.split()}
    return data if not strange else cover(False, "closed loops" if "loops" in strange else ", ".join(sorted(strange)))
def unique(pairs): return dict(pairs) if len(dict(pairs)) == len(pairs) else need(False, "a name stands twice")
def kinds(body): return unique([(k, MOMENTS[k]) for k in ([] if body.get("massless") else body.get("parameters", MOMENTS))])
def random_prime(n):  # of 81 bits, 1 modulo an even n; the strong test is a proof below 3.3e24 (Sorenson and Webster, 2015)
    while True:
        p = 1 + n * RANDOM.randrange(2**80 // n + 1, 2**81 // n)  # p − 1 is halved until it is odd
        powers = ([pow(a, p >> k, p) for k in range(1, (p - 1 & 1 - p).bit_length())] for a in PRIMES)
        if all(x[-1] == 1 or p - 1 in x for x in powers): return p
def cross(a, b): return [a[i - 2] * b[i - 1] - a[i - 1] * b[i - 2] for i in range(3)]
def bracket(a, b): return [*cross(a[:3], b[:3]), *map(add, cross(a[:3], b[3:]), cross(a[3:], b[:3]))]
def matrix(twist): return [*zip(*(cross(twist[:3], axis[:3]) for axis in ONE[:3]), twist[3:], strict=True), [0] * 4]
def evaluate(text, look_up):  # an expression by Python's grammar; names, calls, entries [...] are looked up
    text = text.strip(" ").replace("^", "**") if text.isprintable() else cover(False, ascii(text[:60]))
    def value(node):
        source = text.encode()[node.col_offset:node.end_col_offset].decode()
        if isinstance(node, ast.Name | ast.Call | ast.Subscript): return look_up(source)
        if isinstance(node, ast.Constant) and re.fullmatch(NUMBER, source): return Fraction(source)
        operands = [value(getattr(node, part)) for part in ("left", "operand", "right") if hasattr(node, part)]
        power = source.count("**") == 1 and operands[-1] in range(-16, 17)  # powers of powers are not in the bound
        cover(operands and type(node.op) in OPERATIONS and (power or not isinstance(node.op, ast.Pow)), f"{source[:60]!r}")
        return OPERATIONS[type(node.op)](*operands)
    return value(ast.parse(text, mode="eval").body)

class Robot:
    """A saved model modulo a random prime p, with stated or random values of its symbols, and rows of X at random states."""
    def __init__(self, model, at_values):
        self.model = only(model, "echelon name symbols gravity couplings actuators effects outputs bodies")
        values = {n: entry.get("value") if isinstance(entry, dict) else entry for n, entry in model.get("symbols", {}).items()}
        self.stated = {name: text for name, text in values.items() if text is not None and at_values}
        self.order = n = ROOT_OF_1 if at_values else 24
        self.p, self.largest_power, self.angles, self.sensed = random_prime(n), 1, defaultdict(self.random), {}
        roots = (pow(self.random(), self.p // n, self.p) for _ in iter(int, 1))  # of 1, one of them of order n
        self.root = w = next(w for w in roots if all(pow(w, n // k, self.p) != 1 for k in PRIMES if n % k == 0))
        root2, root3 = (pow(w, n // k, self.p) + pow(w, -n // k, self.p) for k in (8, 12))
        self.known, self.read = {"sqrt(2)": root2, "sqrt(3)": root3, "sqrt(6)": root2 * root3}, functools.cache(self.read)
        names = {(k, body["label"]): k + body["label"] for body in model["bodies"] for k in kinds(body)}  # shared with a label
        self.parameters = [*unique([(n, 0) for n in [*names.values(), *(e["parameter"] for e in model.get("effects", []))]])]
        gravity = {"none": "000", "generic": ["gx", "gy", "gz"]}.get(str(model["gravity"]), model["gravity"])
        self.weight = [0, 0, 0, *(-self.read(g) for g in gravity)]
        steps = [step for body in model["bodies"] for step in only(body["joint"], "type kind name steps")["steps"]]
        motions = self.motions = unique([(step["name"], step["motion"]) for step in steps if "motion" in step])
        followers, actuators = unique([x for entry in model.get("couplings", []) for x in entry.items()]), model.get("actuators", {})
        axes = {name: [f"{name}.{c}" for c in "xyz"] if kind == "ball" else [name] for name, kind in motions.items()}
        self.free = [*unique([(axis, 0) for name in axes if name not in followers for axis in axes[name]])]
        self.ratios, self.symbolic = {x: {x: Fraction(1)} for x in self.free}, set()  # what depends on them
        for name, entry in [*followers.items(), *actuators.items()]:
            terms = only(entry, "terms")["terms"]
            known = {*terms} <= {*self.free} and name not in self.ratios
            cover(known and {*map(type, terms.values())} <= {str}, f"how {name!r} depends on others")
            self.ratios[name] = {x: evaluate(ratio, self.look_up) for x, ratio in terms.items()}
            if not re.fullmatch("[-+*/(). 0-9e]*", "".join(terms.values())): self.symbolic.add(name)
        cover(all(motions[n] == "translation" for n in {*followers} & self.symbolic), "an angle with a ratio that is a symbol")
        self.part = math.lcm(*(r.denominator for terms in self.ratios.values() for r in terms.values()))  # of an angle
        self.rates = {name: {x: self.residue(r) for x, r in terms.items()} for name, terms in self.ratios.items()}
        self.drives = [*actuators, *(x for x in self.free if not any(x in self.ratios[a] for a in actuators))]
        points = [{(kind, x): self.random() for kind in STATE for x in self.free} for _ in range(2)]
        self.points = [{f"{kind}[{name}]": sum(r * point[kind, x] for x, r in self.ratios[name].items() for point in some)
                        for kind in STATE for name in self.ratios.keys() - self.symbolic} for some in (points[:1], points[1:], points)]
        self.outputs = unique([self.output(e) for e in model.get("outputs", [{"actuator": n, "name": n} for n in self.drives])])
        moves, leads = defaultdict(dict), {}  # how far the i-th output's displacement moves drives, sensors and coordinates
        for i, weights in enumerate(self.outputs.values()):
            for place, weight in weights.items(): moves[place][i] = weight
        for a in self.drives: self.extend(leads, self.rates[a] | self.combination([(-1, moves["actuator", a])]), self.free)
        cover(len(leads) == len(self.free) == len(self.drives), "drives that leave joints open")
        for x, row in [(x, {x: 1}) for x in self.free]:
            self.extend(leads, row, self.free)  # until only outputs remain
            moves[x] = self.combination([(1, row), (1, moves["joint", x])])
        self.moves = {**moves} | {n: self.combination((rate, moves[x]) for x, rate in rates.items()) for n, rates in self.rates.items()}
    def random(self): return RANDOM.randrange(1, self.p)
    def residue(self, x): return x.numerator * pow(x.denominator, -1, self.p) % self.p
    def read(self, text, over="1"): return self.residue(evaluate(text, self.look_up) / evaluate(over, self.look_up))
    def times(self, A, B): return [[sum(map(mul, row, column)) % self.p for column in zip(*B, strict=True)] for row in A]
    def plus(self, x, factor, y): return [(a + factor * b) % self.p for a, b in zip(x, y, strict=True)]
    def combination(self, terms):  # of sparse rows, for pairs of a factor and a row
        total = defaultdict(int)
        for factor, row in terms:
            for k, x in row.items(): total[k] += factor * x
        return {k: x % self.p for k, x in total.items() if x % self.p}
    def extend(self, leads, row, columns):  # an echelon form by what remains of a sparse row in these columns
        for k in filter(row.get, columns):
            if k not in leads: leads[k] = self.combination([(pow(row[k], -1, self.p), row)])  # then nothing remains
            x = row[k]
            for n, y in leads[k].items(): row[n] = (row.get(n, 0) - x * y) % self.p
    def rank(self, columns, leads=()):  # of X; until its rows span all, a new state adds to them
        found = dict(leads)
        for row in self.rows(): self.extend(found, {k: row[k] for k in columns if k in row}, columns)
        return len(found) if len(found) in (len(leads), len(columns)) else self.rank(columns, found)
    def cosine_sine(self, *powers):  # of the sum of n u over pairs of z = e^(iu) and n
        self.largest_power = max(self.largest_power, sum(abs(n) for _, n in powers))
        a, b = (math.prod(pow(z, sign * n, self.p) for z, n in powers) for sign in (1, -1))
        return self.residue(Fraction(a + b, 2)), self.residue(Fraction(a - b, 2 * pow(self.root, self.order // 4, self.p)))
    def angle(self, name):  # e^(iu) of a symbol u; if its value is stated, powers of a root of 1 and of the finest angle's
        if name not in self.stated: return self.angles[name] if name != "pi" else cover(False, "cos(pi)")
        zero, one, other = (evaluate(self.stated[name], {"pi": Fraction(pi)}.__getitem__) for pi in (0, 1, ANY))
        turn, rest = (one - zero) * self.order / 2, zero * PARTS_OF_RADIAN
        cover(other == (one - zero) * ANY + zero and turn.denominator == rest.denominator == 1, f"the angle {self.stated[name]!r}")
        return pow(self.root, int(turn), self.p) * pow(self.angles[PARTS_OF_RADIAN], int(rest), self.p)
    def look_up(self, text):  # the value of a symbol, root, sine or cosine
        call = re.fullmatch(CIRCULAR, text)
        if text not in self.known and call:
            self.known[text] = self.cosine_sine((self.angle(call[3]), int(call[2] or 1)))[call[1] == "sin"]
        elif text not in self.known:
            cover(text.isidentifier() and (text != "pi" or not self.stated), f"{text[:60]!r}")
            self.known[text] = self.read(self.stated[text]) if text in self.stated else self.random()
        return Fraction(self.known[text])
    def frame(self, data):
        R = [[self.read(x) for x in row] for row in only(data, "xyz rotation").get("rotation", ("100", "010", "001"))]
        x, y, z = zip(*R, strict=True)
        need(self.times([x, y, z, cross(x, y)], R) == [row[:3] for row in (*ONE[:3], ONE[2])], "a matrix that is not a rotation")
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
        self.sensed[place != "base" and place, entry["fixed_to"], len(self.sensed)] = motion
        return f"{entry['name']}.{kind}{letter}", {[*self.sensed][-1]: 1}
    def step(self, data):  # the matrix S of a frame or an elementary motion, and by coordinate the twists behind it
        if "motion" not in data: return self.frame(data), {}
        kind, name, letters = only(data, "motion name axis pitch")["motion"], data["name"], data["axis"]
        cover(kind in ("rotation", "translation", "screw", "ball"), f"a {kind!r}")
        axis = [(x == letters[-1]) * (-1 if letters[0] == "-" else 1) for x in "xyz"]
        pitch, at = {"screw": data.get("pitch"), "translation": "1"}.get(kind, "0"), self.known.get(f"q[{name}]", 0)
        turn, slide = [0, 0, 0] if kind == "translation" else axis, [x * self.read(pitch) for x in axis]
        if kind == "ball":  # any rotation is 1 + 2 (K + K²) / (1 + |e|²), where K x = e × x (Cayley)
            turn, twists = [self.random() for _ in range(3)], {f"{name}.{x}": [*ONE[k][:3], 0, 0, 0] for k, x in enumerate("xyz")}
            s = self.residue(Fraction(2, 1 + sum(map(mul, turn, turn))))
            c = 1 - s
        else:
            terms, twists = self.ratios[name].items() if any(turn) else (), {name: [*turn, *slide]}
            c, s = self.cosine_sine(*((self.angles["joint", x], int(ratio * self.part)) for x, ratio in terms))
        K, T = matrix([*turn, 0, 0, 0]), matrix([0, 0, 0, *slide])
        return [[a + s * b + (1 - c) * bb + at * d for a, b, bb, d in zip(*rows, strict=True)]
                for rows in zip(ONE, K, self.times(K, K), T, strict=True)], twists
    def rows(self):  # 2 X at a new state: for each output the entries that are not 0, by parameter
        self.signs, currents = defaultdict(self.random), {f"i[{name}]": self.random() for name in self.ratios}
        self.angles, self.known = self.angles | {("joint", x): self.random() for x in self.free}, self.known | currents
        for kind in STATE:  # velocity and acceleration move coordinates as displacements do
            now = {x: self.random() for x in self.free if kind != "q" or x in self.motions}  # a ball has no position
            for name, rates in [(name, rates) for name, rates in self.rates.items() if rates.keys() <= now.keys()]:
                self.known[f"{kind}[{name}]"] = self.moves[name][kind] = sum(rate * now[x] for x, rate in rates.items()) % self.p
        rows, placed = [defaultdict(int) for _ in self.outputs], {(): (ONE, {"qd": [0] * 6, "qdd": self.weight})}
        for body in [{"name": False, "parent": (), "joint": {"steps": []}, "massless": True}, *self.model["bodies"]]:
            name = only(body, "name label parent joint massless parameters separate inertial")["name"]
            cover(name not in placed, "bodies of one name")
            H, moved = placed[body.get("parent", False)]  # moved: twists of displacements and others, in the base frame
            ends = [{p: twist for p, twist in self.sensed.items() if p[:2] == (name, side)} for side in ("parent", "body")]
            for S, twists in [(ONE, ends[0]), *map(self.step, body["joint"]["steps"]), (ONE, ends[1])]:
                H, before, moved = self.times(H, S), moved["qd"], {**moved}
                for place, twist in twists.items():
                    turn, slide = ([sum(map(mul, row, part)) for row in H[:3]] for part in (twist[:3], twist[3:]))
                    there = [*turn, *map(add, slide, cross([row[3] for row in H[:3]], turn))]
                    for i, far in self.moves[place].items(): moved[i] = self.plus(moved.get(i, [0] * 6), far, there)
                moved["qdd"] = self.plus(moved["qdd"], 1, bracket(before, moved["qd"]))
            placed[name], V, A = (H, moved), matrix(moved["qd"]), matrix(moved["qdd"])  # Ḣ = V H, and Ḧ − G = (A + V V) H
            F = [self.plus(a, 1, v) for a, v in zip(self.times(A, H), self.times(V, self.times(V, H)), strict=True)]
            works = {(i, j): [*cross(h[:3], f[:3]), *(h[3] * x for x in f[:3])]  # tr(ξ h fᵀ) is linear in the twist ξ
                     for i, h in enumerate(zip(*H, strict=True)) for j, f in enumerate(zip(*F, strict=True))}
            for kind, J in kinds(body).items():
                work = [sum(x * works[place][k] for place, x in J.items()) % self.p for k in range(6)]
                for i in moved.keys() - {*STATE}: rows[i][kind + body["label"]] += sum(map(mul, moved[i], work))
        for effect in self.model.get("effects", []):
            for act in only(effect, "parameter unit acts value")["acts"]:
                force, far = 2 * self.force(**act), self.moves[act["at"] if act["side"] == "joint" else ("actuator", act["at"])]
                for i in far.keys() - {*STATE}: rows[i][effect["parameter"]] += far[i] * force
        return [self.combination([(1, row)]) for row in rows]
    def force(self, at, side, term):  # of an effect per unit
        cover(at in {"joint": self.ratios, "actuator": self.drives}[side], f"an effect at {at!r}")
        text = re.sub(r"(?<![\w\[])(qdd|qd|q|i)(?![\w\[])", rf"\1[{at!r}]", term)
        one, two, three = (evaluate(text, lambda name, n=n: self.of_state(name, n)) for n in (1, 2, 3))
        cover(not self.residue(one + three - 2 * two), f"products of signs: {term[:60]!r}")
        return self.residue(one)
    def of_state(self, text, scale):  # of an effect; signs are scaled, which shows if a term is linear in them
        found = re.fullmatch(r"(sign|abs)\((.*)\)", text := re.sub("""["']""", "", text))
        if not found: return self.look_up(text)
        value, what = self.residue(evaluate(found[2], self.look_up)), f"the sign of {found[2][:60]!r}"
        a, b, both = (evaluate(found[2], lambda n, at=at: at[n] if n in at else cover(False, what)) for at in self.points)
        cover(a and b and a + b == both, what)  # it is linear, and its sign changes with that of proportional ones alone
        sign = self.signs[a / b] * (1 if a > 0 else -1)
        return Fraction(scale * sign * (value if found[1] == "abs" else 1))

def verify(data):  # what was found, in a sentence
    model, base = only(data, KEYS + " model largest_coefficient")["model"], data["base"]
    cover((data["schema"], model["echelon"], type(data["generic"])) == ("echelon.base-model/1", 1, bool), "this schema")
    own, pivots, rounds, log_error = Robot(model, not data["generic"]), [row["name"] for row in base], 0, 0
    need(sorted(data["parameters"]) == sorted(data["order"]) == sorted(own.parameters), "its parameters are not those of its model")
    need((data["outputs"], data["rank"]) == ([*own.outputs], len(pivots)), "its outputs or its rank are others")
    terms = [(row["name"], only(t, "parameter coefficient denominator value")) for row in base for t in row["terms"]]
    while log_error > -30 * math.log(10):
        robot = Robot(model, False)
        B = [(pivot, {t["parameter"]: robot.read(t["coefficient"], t.get("denominator", "1"))}) for pivot, t in terms]
        for row in robot.rows():
            left = robot.combination([(1, row), *((-row[pivot], term) for pivot, term in B if pivot in row)])
            need(not left, f"it is not complete: it does not reproduce the effect of {[*left][:4]}")
        size = 128 * robot.largest_power * len(json.dumps([model, terms]))
        cover(size < 2**60, "such large multiples of an angle")
        rounds, log_error = rounds + 1, log_error + math.log(size / 2**80 + 8 * 16 * size / 80 / 2**70)
    rank, whom = own.rank(pivots), "at the stated values" if own.stated else "for general values of the symbols"
    need(rank == len(pivots), f"it is not minimal: of its {len(pivots)} rows only {rank} are independent")
    if data["generic"]:
        stated, said = Robot(model, True), data["special"] and (data["special"]["rank"], data["special"]["generic_rank"])
        truth = (stated.rank(stated.parameters), rank) if stated.rank(pivots) < rank else None
        need(said == truth, f"it does not say that at the stated values {truth[0] if truth else rank} of {rank} are independent")
        whom += f" ({truth[0]} at the stated ones)" if truth else ""
    names = [*own.parameters, *model.get("symbols", {})]
    odd = [n for n in names if not re.fullmatch("(?!pi$)[A-Za-z_][A-Za-z_0-9]*", n) or names.count(n) > 1]
    cover(not odd and {*map(type, own.free)} <= {str}, f"names that may read as formulas: {', '.join(map(ascii, odd[:4]))}")
    return (f"valid: {rank} base parameters of {len(own.parameters)} {whom}, minimal by a minor, complete modulo {rounds} primes "
            f"of 81 bits, error probability below 1e{math.ceil(log_error / math.log(10))}")
def judge(text: str | bytes) -> tuple[int, str]:  # the exit code and a sentence for the text of a file
    try: return 0, verify(json.loads(text, object_pairs_hook=unique))
    except AssertionError as problem: return 1, f"NOT valid: {problem}"
    except (NotImplementedError, RecursionError, MemoryError) as what: return 3, f"NOT checked: not covered here: {what}"
    except (ArithmeticError, AttributeError, LookupError, SyntaxError, TypeError, ValueError) as error:
        return 2, f"not readable: {type(error).__name__}: {error}"
if __name__ == "__main__":
    code, sentence = judge(open(sys.argv[1], "rb").read())
    sys.exit(print(sentence) or code)
