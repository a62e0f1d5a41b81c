"""Check a saved set of base parameters with this file and Python: trees modulo random primes, loops in 150 digits.

    python echelon_verify.py set.json        exit codes: 0 valid, 1 NOT valid, 2 not readable, 3 not covered here
The virtual work of what is measured is Σ m δx·(a − g).  A particle p of a body is at H (p, 1), which a displacement moves by
δH = ξ H with a twist ξ, so a body adds tr(ξ H J (Ḧ − G)ᵀ): J = ∫ (p, 1)(p, 1)ᵀ dm is linear in its ten parameters, g the last
column of G.  An angle u is a random e^(iu), a sign a random number, loops are closed by Newton.  Why: docs/verification.md."""
import ast, decimal, functools, itertools, json, math, re, secrets, sys
from collections import defaultdict
from decimal import Decimal
from fractions import Fraction
from operator import add, mul, neg, sub, truediv
OPERATIONS = {ast.Add: add, ast.Sub: sub, ast.Mult: mul, ast.Div: truediv, ast.USub: neg, ast.Pow: pow}
KEYS = "schema echelon name seed rank outputs parameters order base classification reading special generic certificate model"
MODEL = "echelon name symbols gravity couplings actuators effects outputs bodies experiments contacts"
RANDOM, STATE, ONE = secrets.SystemRandom(), ("q", "qd", "qdd"), [[int(i == j) for j in range(4)] for i in range(4)]
PRIMES, ROOT_OF_1, PARTS_OF_RADIAN = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41), 2 * math.lcm(*range(1, 21), 1000), 10**24
NUMBER, CIRCULAR, ANY = r"[0-9.]{1,4000}(e[-+]?[0-9]{1,2})?", r"(cos|sin)\((?:([0-9]{1,9})\*)?(\w+)\)", RANDOM.randrange(2**64)
MOMENTS = {a + a: {(k, k): 1 - 2 * (k == i) for k in range(3)} for i, a in enumerate("XYZ")}  # 2 J for a unit
MOMENTS |= {"XY": {(0, 1): -2, (1, 0): -2}, "XZ": {(0, 2): -2, (2, 0): -2}, "YZ": {(1, 2): -2, (2, 1): -2}, "M": {(3, 3): 2}}
MOMENTS |= {"M" + a: {(i, 3): 2, (3, i): 2} for i, a in enumerate("XYZ")}
POINT, AXIS, TURN = [(0, 3), (1, 3), (2, 3)], [(0, 2), (1, 2), (2, 2)], [(i, j) for i in range(3) for j in range(3)]
CLOSURES = {"weld": TURN + POINT, "revolute": AXIS + POINT, "prismatic": TURN + POINT[:2], "cylindrical": AXIS + POINT[:2], "spherical":
            POINT, "planar": AXIS + POINT[2:], "universal": [(0, 1), *POINT], "point_on_axis": POINT[:2], "point_on_plane": POINT[2:]}
HELD = {"point": "", "line": "yz", "surface": "xyz", "rolling": ""}  # axes about which a contact does not turn
DIGITS, HUGE, CLOSED, ZERO, LEFT, FALSE, SMALL, NEAR = 150, 10**20, *map(Decimal, ("1e-130", "1e-80", "1e-60", "1e-40", "1e-6", "0.1"))

def fail(error): raise error
def need(condition, problem): return condition or fail(AssertionError(problem))  # the set is not valid
def cover(condition, what): return condition or fail(NotImplementedError(what))  # the set may be valid
def only(data, keys):  # one that is not known here may change what the others mean
    return data if {*data} <= {*keys.split()} else cover(False, ", ".join(sorted({*data} - {*keys.split()})))
class Entry(dict): __hash__ = object.__hash__  # by identity
def unique(pairs): return Entry(pairs) if len(dict(pairs)) == len(pairs) else need(False, "a name stands twice")
def kinds(body): return unique([(k, MOMENTS[k]) for k in ([] if body.get("massless") else body.get("parameters", MOMENTS))])
def random_prime(n):  # of 81 bits, 1 modulo an even n; the strong test is a proof below 3.3e24 (Sorenson and Webster, 2015)
    numbers = (1 + n * RANDOM.randrange(2**80 // n + 1, 2**81 // n) for _ in iter(int, 1))  # p − 1 is halved until it is odd
    halved = ((p, [p >> k for k in range(1, (p - 1 & 1 - p).bit_length())]) for p in numbers)
    return next(p for p, x in halved if all(pow(a, x[-1], p) == 1 or p - 1 in [pow(a, k, p) for k in x] for a in PRIMES))
def cross(a, b): return [a[i - 2] * b[i - 1] - a[i - 1] * b[i - 2] for i in range(3)]
def bracket(a, b): return [*cross(a[:3], b[:3]), *map(add, cross(a[:3], b[3:]), cross(a[3:], b[:3]))]
def work(h, f): return [*cross(h[:3], f[:3]), *(h[3] * x for x in f[:3])]  # tr(ξ h fᵀ) is linear in the twist ξ
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
        self.model = only(model, MODEL + " loops independent assembly poses rounding" * ("loops" in model))
        values = {n: entry.get("value") if isinstance(entry, dict) else entry for n, entry in model.get("symbols", {}).items()}
        self.read, self.frame = functools.cache(self.read), functools.cache(self.frame)
        self.largest_power, self.angles, self.sensed, self.contacts = 1, defaultdict(self.random), {}, model.get("contacts", [])
        self.numbers({name: text for name, text in values.items() if text is not None}, at_values)
        names = {(k, body["label"]): k + body["label"] for body in model["bodies"] for k in kinds(body)}  # shared with a label
        self.parameters = [*unique([(n, 0) for n in [*names.values(), *(e["parameter"] for e in model.get("effects", []))]])]
        self.gravity = {"none": ["0"] * 3, "generic": ["gx", "gy", "gz"]}.get(str(model["gravity"]), model["gravity"])
        steps = [step for body in model["bodies"] for step in only(body["joint"], "type kind name steps")["steps"]]
        motions = self.motions = unique([(step["name"], step["motion"]) for step in steps if "motion" in step])
        followers, actuators = unique([x for entry in model.get("couplings", []) for x in entry.items()]), model.get("actuators", {})
        axes = {n: [f"{n}.{c}" for c in "xyz"] if kind == "ball" else [n] for n, kind in motions.items() if n not in followers}
        self.free = [*unique([(axis, 0) for name in axes for axis in axes[name]])]
        self.driven = model.get("independent", self.free)
        self.ratios, self.symbolic = {x: {x: Fraction(1)} for x in self.free}, set()  # what depends on them
        for name, entry in [*followers.items(), *actuators.items()]:
            terms = only(entry, "terms")["terms"]
            known = {*terms} <= {*(self.free if name in followers else self.driven)} and name not in self.ratios
            cover(known and {*map(type, terms.values())} <= {str}, f"how {name!r} depends on others")
            self.ratios[name] = {x: evaluate(ratio, self.look_up) for x, ratio in terms.items()}
            if not re.fullmatch("[-+*/(). 0-9e]*", "".join(terms.values())): self.symbolic.add(name)
        cover(all(motions[n] == "translation" for n in {*followers} & self.symbolic), "an angle with a ratio that is a symbol")
        self.part = math.lcm(*(r.denominator for terms in self.ratios.values() for r in terms.values()))  # of an angle
        self.rates = {name: {x: self.residue(r) for x, r in terms.items()} for name, terms in self.ratios.items()}
        self.drives = [*actuators, *(x for x in self.driven if not any(x in self.ratios[a] for a in actuators))]
        points = [{(kind, x): RANDOM.randrange(1, 2**80) for kind in STATE for x in self.free} for _ in range(2)]
        self.points = [{f"{kind}[{name}]": sum(r * point[kind, x] for x, r in self.ratios[name].items() for point in some)
                        for kind in STATE for name in self.ratios.keys() - self.symbolic} for some in (points[:1], points[1:], points)]
        self.outputs = unique([self.output(e) for e in model.get("outputs", [{"actuator": n, "name": n} for n in self.drives])])
        moves, leads = defaultdict(dict), {}  # how far the i-th output's displacement moves drives, sensors and coordinates
        for i, (place, x) in [(i, pair) for i, weights in enumerate(self.outputs.values()) for pair in weights.items()]: moves[place][i] = x
        for a in self.drives: self.extend(leads, self.rates[a] | self.combination([(-1, moves["actuator", a])]), self.driven)
        cover(len(leads) == len(self.driven) == len(self.drives), "drives that leave joints open")
        for x in self.driven: moves[x] = self.combination([(1, self.remains({x: 1}, leads)), (1, moves["joint", x])])
        self.moves = self.base = self.follow(moves)
    def numbers(self, stated, at_values):  # a prime and roots modulo it
        self.stated, self.order = (stated, ROOT_OF_1) if at_values else ({}, 24)
        self.p, n = random_prime(self.order), self.order
        roots = (pow(self.random(), self.p // n, self.p) for _ in iter(int, 1))  # of 1, one of them of order n
        self.root = w = next(w for w in roots if all(pow(w, n // k, self.p) != 1 for k in PRIMES if n % k == 0))
        root2, root3 = (pow(w, n // k, self.p) + pow(w, -n // k, self.p) for k in (8, 12))
        self.known = {"sqrt(2)": root2, "sqrt(3)": root3, "sqrt(6)": root2 * root3}
    def follow(self, moves):  # what depends on coordinates by ratios moves with them
        return {**moves} | {n: self.combination((rate, moves[x]) for x, rate in rates.items()) for n, rates in self.rates.items()}
    def random(self): return RANDOM.randrange(1, self.p)
    def rest(self, x): return x % self.p  # 0 if it is zero
    def residue(self, x): return x.numerator * pow(x.denominator, -1, self.p) % self.p
    def read(self, text, over="1"): return self.residue(evaluate(text, self.look_up) / evaluate(over, self.look_up))
    def times(self, A, B): return [[sum(map(mul, row, column)) % self.p for column in zip(*B, strict=True)] for row in A]
    def plus(self, x, factor, y): return [(a + factor * b) % self.p for a, b in zip(x, y, strict=True)]
    def combination(self, terms):  # of sparse rows, for pairs of a factor and a row
        total = defaultdict(int)
        for factor, row in terms:
            for k, x in row.items(): total[k] += factor * x
        return {k: x % self.p for k, x in total.items() if x % self.p}
    def remains(self, row, leads):  # of a sparse row beside those of an echelon form
        row = {**row}
        for k, lead in leads.items():
            for x, (n, y) in itertools.product([row.pop(k)], lead.items()) if row.get(k) else (): row[n] = (row.get(n, 0) - x * y) % self.p
        return row
    def extend(self, leads, row, columns):  # an echelon form by a row, if something remains of it in these columns
        row = self.remains(row, leads)
        k = max((k for k in columns if self.rest(row.get(k, 0))), key=lambda k: min(abs(row[k]), HUGE), default=None)
        if k is not None: leads[k] = self.combination([(self.residue(1 / Fraction(row.pop(k))), row)])
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
        if text not in self.known and (call := re.fullmatch(CIRCULAR, text)):
            self.known[text] = self.cosine_sine((self.angle(call[3]), int(call[2] or 1)))[call[1] == "sin"]
        elif text not in self.known:
            cover(text.isidentifier() and (text != "pi" or not self.stated), f"{text[:60]!r}")
            self.known[text] = self.read(self.stated[text]) if text in self.stated else self.random()
        return Fraction(self.known[text])
    def frame(self, data):
        R = [[self.read(x) for x in row] for row in only(data, "xyz rotation").get("rotation", ("100", "010", "001"))]
        x, y, z = zip(*R, strict=True)
        misses = map(self.plus, self.times([x, y, z, cross(x, y)], R), 4 * [-1], [row[:3] for row in (*ONE[:3], ONE[2])])
        need(not any(self.rest(x) for row in misses for x in row), "a matrix that is not a rotation")
        return [[*row, self.read(t)] for row, t in zip(R, data.get("xyz", "000"), strict=True)] + [ONE[3]]
    def output(self, data):  # the name of an output, and weights of the displacements along which it measures, one of its own
        terms = only(data, "name unit sum reads")["sum"] if "sum" in data else [data]
        name, sums = ".".join([data["name"], *data.get("components", [])]), [(self.at(t), self.read(t.get("weight", "1"))) for t in terms]
        return name, unique([*sums, (("output", data.get("reads") or name), 1)])
    def at(self, term):  # of a displacement: along a joint, along a drive, or of a sensor between bodies
        (side,) = {*only(term, "name joint actuator wrench frame fixed_to components component weight")} & {"joint", "actuator", "wrench"}
        names = {"joint": self.driven, "actuator": self.drives, "wrench": ["base", *(body["name"] for body in self.model["bodies"])]}[side]
        if cover([*names].count(term[side]) == 1, f"a sensor at {term[side]!r}") and side != "wrench": return side, term[side]
        frame, ((kind, letter),), body = self.frame(term["frame"]), term.get("components", [term.get("component")]), term["wrench"]
        *axis, _ = [row["xyz".index(letter)] for row in frame]
        motion = [*axis, *cross([row[3] for row in frame[:3]], axis)] if kind == "t" else [0, 0, 0, *axis]
        return self.sensed.update({(key := (body != "base" and body, term["fixed_to"], len(self.sensed))): motion}) or key
    def step(self, data):  # the matrix S of a frame or an elementary motion, and by coordinate the twists behind it
        if "motion" not in data: return self.frame(data), {}
        kind, name, letters = only(data, "motion name axis pitch")["motion"], data["name"], data["axis"]
        cover(kind in ("rotation", "translation", "screw", "ball"), f"a {kind!r}")
        axis = [(x == letters[-1]) * (-1 if letters[0] == "-" else 1) for x in "xyz"]
        pitch, at = {"screw": data.get("pitch"), "translation": "1"}.get(kind, "0"), self.known.get(f"q[{name}]", 0)
        turn, slide = [0, 0, 0] if kind == "translation" else axis, [x * self.read(pitch) for x in axis]
        if kind == "ball":  # any rotation is 1 + 2 (w K + K²) / (w² + |e|²), where K x = e × x (Cayley)
            (w, *turn), twists = self.balls[name], {f"{name}.{x}": [*ONE[k][:3], 0, 0, 0] for k, x in enumerate("xyz")}
            c, s = 1 - (s := self.residue(2 / Fraction(w * w + sum(map(mul, turn, turn))))), w * s
        else:
            terms, twists = self.ratios[name].items() if any(turn) else (), {name: [*turn, *slide]}
            c, s = self.cosine_sine(*((self.angles["joint", x], int(ratio * self.part)) for x, ratio in terms))
        K, T = matrix([*turn, 0, 0, 0]), matrix([0, 0, 0, *slide])
        return [[a + s * b + (1 - c) * bb + at * d for a, b, bb, d in zip(*rows, strict=True)]
                for rows in zip(ONE, K, self.times(K, K), T, strict=True)], twists
    def draw(self):  # a random state in which no contact slips
        self.angles |= {("joint", x): self.random() for x in self.free}
        self.balls = {name: [1, *(self.random() for _ in "xyz")] for name in self.motions}
        state = {x: {kind: self.random() for kind in STATE} for x in self.free}
        for n in (1, 2) if self.contacts else ():  # velocities, then accelerations: some follow others, so that nothing slips
            alone, leads = {x: {x: 1} | {kind: state[x][kind] for kind in STATE[:n]} for x in self.free}, {}
            self.know(alone | {sensor: {} for sensor in self.sensed})
            for slip, _ in self.slips(self.poses()): self.extend(leads, slip, self.free)
            for k, way in [(k, self.remains({k: 1}, leads)) for k in leads]:
                state[k][STATE[n]] = sum(y * (1 if x is None else state[x][STATE[n]]) for x, y in way.items()) % self.p
        self.know(self.base | {x: self.base[x] | state[x] for x in self.free})
    def know(self, moves):  # displacements, and with them the state
        self.moves = self.follow(moves)
        self.known |= {f"{kind}[{name}]": self.moves[name][kind] for name, rates in self.rates.items() for kind in STATE
                       if kind in self.moves[name] and (kind != "q" or rates.keys() <= self.motions.keys())}  # a ball has no position
    def slips(self, placed):  # by displacement, of each component of a contact, None: its rate; and if its force is unknown
        for c in [only(contact, "name type body at radius measured") for contact in self.contacts]:
            pull, (H, moved) = [0, 0, 1], placed[c["body"]]
            if c["type"] == "rolling": pull = [evaluate(g, lambda _: cover(False, "rolling, and symbols in gravity")) for g in self.gravity]
            cover(sum(map(bool, pull)) == 1, "rolling where gravity is along no axis")
            *axes, x = zip(*self.times(H, self.frame(c["at"]))[:3], strict=True)
            foot = self.plus(x, self.read(c.get("radius", "0")), [(g > 0) - (g < 0) for g in pull])
            turn, slide, far = moved["qd"][:3], moved["qd"][3:], self.plus(moved["qdd"], -1, placed[False][1]["qdd"])
            bend = cross(turn, self.plus(slide, 1, cross(turn, x)))  # what makes the contact's frame accelerate without qdd
            ways = {"f" + k: [*cross(foot, e), *e] for k, e in zip("xyz", axes, strict=True)}
            ways |= {"t" + k: [*axes["xyz".index(k)], 0, 0, 0] for k in HELD[c["type"]]}
            for k, way in ways.items():
                slip = {i: sum(map(mul, way, twist)) % self.p for i, twist in moved.items() if i not in STATE}
                rate = sum(map(mul, way, far)) + sum(map(mul, way[3:], bend))
                yield slip | {None: rate % self.p}, k not in c.get("measured", [])
    def poses(self):  # H of bodies by name, with the twists there of displacements and others, in the base frame
        placed = {(): (ONE, {"qd": [0] * 6, "qdd": [0, 0, 0, *(-self.read(g) for g in self.gravity)]})}
        for body in [{"name": False, "parent": (), "joint": {"steps": []}, "massless": True}, *self.model["bodies"]]:
            name = only(body, "name label parent joint massless parameters separate inertial")["name"]
            cover(name not in placed, "bodies of one name")
            H, moved = placed[body.get("parent", False)]
            ends = [{p: twist for p, twist in self.sensed.items() if p[:2] == (name, side)} for side in ("parent", "body")]
            for S, twists in [(ONE, ends[0]), *map(self.step, body["joint"]["steps"]), (ONE, ends[1])]:
                H, before, moved = self.times(H, S), moved["qd"], {**moved}
                for place, twist in twists.items():
                    turn, slide = ([sum(map(mul, row, part)) for row in H[:3]] for part in (twist[:3], twist[3:]))
                    there = [*turn, *map(add, slide, cross([row[3] for row in H[:3]], turn))]
                    for i, far in self.moves[place].items(): moved[i] = self.plus(moved.get(i, [0] * 6), far, there)
                moved["qdd"] = self.plus(moved["qdd"], 1, bracket(before, moved["qd"]))
            placed[name] = H, moved
        return placed
    def rows(self):  # 2 X at a new state: for each output the entries that are not 0, by parameter
        self.signs, self.known = defaultdict(self.random), self.known | {f"i[{name}]": self.random() for name in self.ratios}
        rows, _, placed = [defaultdict(int) for _ in self.outputs], self.draw(), self.poses()
        for body, (H, moved) in [(body, placed[body["name"]]) for body in self.model["bodies"] if kinds(body)]:
            V, A = matrix(moved["qd"]), matrix(moved["qdd"])  # Ḣ = V H, and Ḧ − G = (A + V V) H
            F = [self.plus(a, 1, v) for a, v in zip(self.times(A, H), self.times(V, self.times(V, H)), strict=True)]
            works = {(i, j): work(h, f) for i, h in enumerate(zip(*H, strict=True)) for j, f in enumerate(zip(*F, strict=True))}
            for kind, J in kinds(body).items():
                done = [sum(x * works[place][k] for place, x in J.items()) % self.p for k in range(6)]
                for i in moved.keys() - {*STATE}: rows[i][kind + body["label"]] += sum(map(mul, moved[i], done))
        for effect in self.model.get("effects", []):
            for act in only(effect, "parameter unit acts value bristles")["acts"]:
                force, far = 2 * self.force(**act), self.moves[act["at"] if act["side"] == "joint" else (act["side"], act["at"])]
                for i in far.keys() - {*STATE}: rows[i][effect["parameter"]] += far[i] * force
        forces, leads = dict(enumerate(slip for slip, unknown in self.slips(placed) if unknown)), {}
        for (i, row), (n, slip) in itertools.product(enumerate(rows), forces.items()): row[n] = slip.get(i, 0)
        for row in (rows := [self.combination([(1, row)]) for row in rows]): self.extend(leads, row, forces)
        return [row for row in (self.remains(row, leads) for row in rows) if row or not forces]  # where no unknown force enters
    def force(self, at, side, term):  # of an effect per unit
        cover(at in {"joint": self.ratios, "actuator": self.drives}.get(side, ()) or (side, at) in self.moves, f"an effect at {at!r}")
        text = re.sub(r"(?<![\w\[])(qdd|qd|q|i)(?![\w\[])", rf"\1[{at!r}]", term)
        one, two, three = (evaluate(text, lambda name, n=n: self.of_state(name, n)) for n in (1, 2, 3))
        cover(not self.residue(one + three - 2 * two), f"products of signs: {term[:60]!r}")
        return self.residue(one)
    def of_state(self, text, scale):  # of an effect; signs are scaled, which shows if a term is linear in them
        found = re.fullmatch(r"(sign|abs)\((.*)\)", text := re.sub("""["']""", "", text))
        if not found: return self.look_up(text)
        value, what = self.residue(evaluate(found[2], self.look_up)), f"the sign of {found[2][:60]!r}"
        a, b, both = (evaluate(found[2], lambda n, at=at: at[n] if n in at else cover(False, what)) for at in self.points)
        ways = min(abs(a), abs(b)) > FALSE and a + b == both  # linear; its sign changes with that of proportional ones alone
        cover(ways and not self.contacts, what)
        return scale * (1 if a > 0 else -1) * Fraction(self.signs[round(a / b, 40)]) * Fraction(value if found[1] == "abs" else 1)

class Linkage(Robot):
    """A saved model with loops in decimals, and rows of X at closed states along a random walk from its assembly pose."""
    def __init__(self, model, at_values):
        super().__init__(model, at_values)
        self.dependent, balls = {*self.free} - {*self.driven}, [name for name, kind in self.motions.items() if kind == "ball"]
        self.alone = self.follow({x: {x: 1} for x in (*self.free, *self.sensed)})  # each coordinate moves for itself
        for self.start, pose in {"the assembly pose": model.get("assembly", {}), **model["poses"]}.items():
            self.q = {x: self.read(str(pose.get(x, 0))) for x in self.free if x in self.motions}
            self.balls = {n: [self.read(str(pose.get(f"{n}.{x}", int(x == "w")))) for x in "wxyz"] for n in balls}
            if self.close({}, {*self.free}, NEAR) and self.close({}, self.dependent, NEAR): return
        cover(False, "an assembly pose at which loops are not closed, or their ways of assembly may meet")
    def numbers(self, stated, at_values):
        near = {n: f"({text} + 7/3)*1.0001{RANDOM.randrange(10**20):020} - 7/3" for n, text in stated.items()}
        self.stated, self.leads, self.p, pi = stated if at_values else near, {}, *map(Decimal, ("Infinity", "3.14159265358979"))
        for _ in "1234": pi += self.cosine_sine((pi, 1))[1]
        self.known = {"pi": pi, **{f"sqrt({n})": Decimal(n).sqrt() for n in (2, 3, 6)}}
        for n, t in [(n, (entry or {}).get("tangent_squared")) for n, entry in self.model.get("symbols", {}).items() if n not in stated]:
            cover(t, "loops with symbols that have no values")
            self.known |= {f"{part}({n})": self.read(f"{x}/(1 + {t})").sqrt() for part, x in (("cos", "1"), ("sin", f"({t})"))}
        texts = json.dumps(self.model | {"poses": 0, "bodies": [body["joint"] for body in self.model["bodies"]]})
        cover(not re.search(r'[0-9.]e[-+]?[2-9]|\.0{19}|"name": "qd?d?"', texts), "numbers of such sizes, or joints called q, qd or qdd")
    def random(self): return Decimal(RANDOM.randrange(-(10**30), 10**30)) / 10**30
    def residue(self, x): return Decimal(x.numerator) / x.denominator
    def rest(self, x): return x if abs(x) > ZERO else 0
    def angle(self, name): return self.read(name)
    def cosine_sine(self, *multiples):  # by Taylor's series for a part of the angle, which is then doubled again
        n = 10 + int(abs(u := Decimal(sum(u * n for u, n in multiples)))).bit_length()
        parts = [*itertools.accumulate(range(1, 48), lambda x, k: x * u / 2**n / k, initial=Decimal(1))]
        c, s = (sum(parts[k::4]) - sum(parts[k + 2::4]) for k in (0, 1))
        for _ in range(n): c, s = c * c - s * s, 2 * c * s
        return c, s
    def follow(self, moves):  # dependent coordinates follow the independent ones and sensors
        return super().follow(moves | {k: self.combination((row[x], moves[x]) for x in row if x in moves) for k, row in self.leads.items()})
    def loops(self, columns):  # how these coordinates follow others, and None: what loops miss, and by how much they accelerate apart
        placed, rows, leads, least = self.poses(), [], {}, 1
        placed |= {None: placed[False], "base": placed.get("base", placed[False])}
        for loop in self.model["loops"]:
            cover(only(loop, "name joint connects at on_second")["joint"] in CLOSURES, f"a loop with {loop['joint']!r}")
            (H, one), (L, two) = (placed[end] for end in loop["connects"])
            H, L = self.times(H, self.frame(loop["at"])), self.times(L, self.frame(loop["on_second"]))
            apart = {x: self.plus(two.get(x, [0] * 6), -1, one.get(x, [0] * 6)) for x in one | two}
            D, A = matrix(apart["qd"]), matrix(self.plus(apart.pop("qdd"), 1, bracket(apart.pop("qd"), two["qd"])))
            N = self.times([self.plus(self.plus(a, 1, b), 1, c) for a, b, c in zip(ONE, A, self.times(D, D), strict=True)], L)
            for i, j in CLOSURES[loop["joint"]]:  # entries of C = H⁻¹ L, where C̈ = H⁻¹ (A + D D) L, as in the unit matrix
                way, miss = work([row[j] for row in L], f := [row[i] for row in H[:3]]), [N[k][j] - L[3][j] * H[k][3] for k in range(3)]
                rows.append({x: y for x, t in apart.items() if (y := sum(map(mul, way, t)))} | {None: sum(map(mul, f, miss)) - ONE[i][j]})
        for _ in self.dependent:  # the largest entry leads
            least, n, k = max(((abs(row[k]), n, k) for n, row in enumerate(rows) for k in row.keys() & columns), default=(0, 0, 0))
            if least < SMALL: break  # ways of assembly may meet
            self.extend(leads, rows[n], [k])
            rows = [self.remains(row, {k: leads[k]}) for row in rows]
        return {k: self.remains({k: 1}, leads) for k in leads}, least, max(abs(x) for row in rows for x in row.values())
    def close(self, step, columns, limit):  # after a step, by Newton's method; whether it does not move coordinates farther
        sizes, self.moves = [1], self.alone
        while sizes[-1] > CLOSED and sum(sizes[1:]) < limit and len(sizes) < 99:
            self.q = {x: q + step.get(x, 0) for x, q in self.q.items()}
            for name, (w, *e) in self.balls.items():
                d = [Decimal(step.get(f"{name}.{x}", 0)) / 2 for x in "xyz"]  # times the quaternion (1, d) of a small turn
                self.balls = self.balls | {name: [w - sum(map(mul, e, d)), *self.plus(self.plus(e, w, d), 1, cross(e, d))]}
            self.angles |= {("joint", x): q / self.part for x, q in self.q.items()}
            self.known |= {f"q[{n}]": sum(r * self.q[x] for x, r in of.items()) for n, of in self.rates.items() if of.keys() <= {*self.q}}
            self.leads, least, left = self.loops(columns)
            sizes.append(max(map(abs, (step := {x: row.get(None, 0) for x, row in self.leads.items()}).values()), default=0))
        closed = least > SMALL and sizes[-1] < CLOSED and sum(sizes[1:]) < limit  # ways of assembly may meet where pivots are small
        cover(not closed or left < LEFT, "loops that do not close in 60 digits, or do not determine what follows or is measured")
        return closed
    def walk(self):  # a step that is so short that Newton's method then moves coordinates by less than a tenth of it
        size, here, closed = Decimal("0.6"), (self.q, self.balls, self.leads), False
        while not closed:
            size, (self.q, self.balls, self.leads) = size / 2, here
            cover(size > SMALL, "a pose that hardly moves")
            way = self.follow({x: {0: self.random()} for x in self.driven})
            part = size / max(1, *(abs(way[x].get(0, 0)) for x in self.free))
            closed = self.close({x: way[x].get(0, 0) * part for x in self.free}, self.dependent, size / 10)
    def draw(self):  # a closed state some steps on, and two velocities that tell which signs change together
        for _ in "123": self.walk()
        given = self.base | {x: self.base[x] | {"qd": self.random(), "qdd": self.random()} for x in self.driven}
        rates, some = self.follow(given), self.follow({x: {k: self.random() for k in "ab"} for x in self.driven})
        self.points = [{f"qd[{n}]": sum(Fraction(some[n].get(k, 0)) for k in which) for n in self.rates} for which in ("a", "b", "ab")]
        self.moves = {x: far | {"qd": rates[x].get("qd", 0)} for x, far in self.alone.items()}
        self.leads, _, _ = self.loops(self.dependent)
        self.know(given | {None: {"qdd": 1}})

def verify(data):  # what was found, in a sentence
    model, base = only(data, KEYS + " largest_coefficient" + " numbers" * (loops := "loops" in data["model"]))["model"], data["base"]
    cover((data["schema"], model["echelon"], type(data["generic"])) == ("echelon.base-model/1", 1, bool), "this schema")
    if loops: model["poses"] = {"reading.assembled": at["pose"]} if (at := data["reading"].get("assembled")) else {}
    own, pivots, rounds, log_error = (Linkage if loops else Robot)(model, not data["generic"]), [row["name"] for row in base], 0, 0
    need(sorted(data["parameters"]) == sorted(data["order"]) == sorted(own.parameters), "its parameters are not those of its model")
    need((data["outputs"], data["rank"]) == ([*own.outputs], len(pivots)), "its outputs or its rank are others")
    terms = [(row["name"], only(t, "parameter coefficient denominator value")) for row in base for t in row["terms"]]
    numbers, radius = (n := data.get("numbers") or {"parameters": (), "radius": 0})["parameters"], Decimal(n["radius"])
    cover(radius < (1e-30 if not data["generic"] else 1e-99), "numbers of so few digits, or general ones")
    while log_error > -30 * math.log(10):
        robot = own if loops else Robot(model, False)
        B = [(pivot, {t["parameter"]: robot.read(t["coefficient"], t.get("denominator", "1"))}) for pivot, t in terms]
        for row in robot.rows():
            left = robot.combination([(1, row), *((-row[pivot], term) for pivot, term in B if pivot in row)])
            left = [k for k, x in left.items() if abs(x) > (FALSE + radius * (k in numbers)) * sum(map(abs, row.values()))]
            need(not left, f"it is not complete: it does not reproduce the effect of {left[:4]}")
        size = 128 * robot.largest_power * len(json.dumps([model, terms])) * (1 + 6 * len(robot.contacts)) ** 2
        cover(size < 2**60, "such large multiples of an angle")
        rounds, log_error = rounds + 1, log_error + (math.log(size / 2**80 + 8 * 16 * size / 80 / 2**70) if not loops else -10)
    rank, general = own.rank(pivots), data["generic"] or not (own.stated or loops)
    need(rank == len(pivots), f"it is not minimal: of its {len(pivots)} rows only {rank} are independent")
    whom = ("for general values of the symbols" + " near the stated ones" * loops) if general else "at the stated values"
    how = f"by a minor, complete modulo {rounds} primes of 81 bits, error probability below 1e{math.ceil(log_error / math.log(10))}"
    if loops: how = f"by pivots above 1e-80, complete to 1e-40 at {rounds} random states that motions reach from {own.start}"
    if data["generic"]:
        stated, said = type(own)(model, True), data["special"] and (data["special"]["rank"], data["special"]["generic_rank"])
        truth = (stated.rank(stated.parameters), rank) if stated.rank(pivots) < rank else None
        need(said == truth, f"it does not say that at the stated values {truth[0] if truth else rank} of {rank} are independent")
        whom += f" ({truth[0]} at the stated ones)" if truth else ""
    names = [*own.parameters, *model.get("symbols", {})]
    odd = [n for n in names if not re.fullmatch("(?!pi$)[A-Za-z_][A-Za-z_0-9]*", n) or names.count(n) > 1]
    cover(not odd and {*map(type, own.free)} <= {str}, f"names that may read as formulas: {', '.join(map(ascii, odd[:4]))}")
    return f"valid: {rank} base parameters of {len(own.parameters)} {whom}, minimal {how}"
def judge(text: str | bytes) -> tuple[int, str]:  # the exit code and a sentence for the text of a file
    try:
        with decimal.localcontext(decimal.Context(DIGITS)): return 0, verify(json.loads(text, object_pairs_hook=unique))
    except AssertionError as problem: return 1, f"NOT valid: {problem}"
    except (NotImplementedError, RecursionError, MemoryError) as what: return 3, f"NOT checked: not covered here: {what}"
    except (ArithmeticError, AttributeError, LookupError, SyntaxError, TypeError, ValueError) as error:
        return 2, f"not readable: {type(error).__name__}: {error}"
if __name__ == "__main__": sys.exit((lambda code, what: print(what) or code)(*judge(open(sys.argv[1], "rb").read())))
