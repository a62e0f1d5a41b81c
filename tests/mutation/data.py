"""Faults in what is read: documents, logs, signals and set-ups."""

from mutation.fault import Fault

FILTERS, SIGNALS = "signals/test_filters.py", "signals/test_signals.py"
UNITS, CLOCK = "logs/test_log_units.py", "logs/test_clock.py"
GUESS = "logs/test_log_guess.py"
LIMITS, SETUP = "inputs/test_documents.py", "identification/test_setup_files.py"

FAULTS = (
    Fault("inputs/content.py", "if found > self.most:", "if found > 2 * self.most:", "limits of what is read", LIMITS),
    Fault(
        "inputs/json_text.py",
        "if len(found) < len(pairs):",
        "if not found and pairs:",
        "keys that occur twice",
        LIMITS,
    ),
    Fault(
        "inputs/yaml_text.py",
        "if key in within.data:",
        "if key in ():",
        "keys that occur twice",
        "formats/test_description.py",
    ),
    Fault("inputs/xml_text.py", "forbid_dtd=True", "forbid_dtd=False", "document types in XML", LIMITS),
    Fault(
        "inputs/yaml_text.py",
        "len(self._open), self._source",
        "len(self._open) - 9, self._source",
        "depth of YAML",
        LIMITS,
    ),
    Fault(
        "logs/columns/by_values.py",
        "return _share(moved, integral) > 0.5",
        "return _share(integral, -moved) > 0.5",
        "velocities by their values",
        GUESS,
    ),
    Fault(
        "logs/columns/column_guess.py",
        "valid[number - first] for",
        "valid[first - number] for",
        "numbers of columns",
        GUESS,
    ),
    Fault(
        "logs/files/hdf5_file.py",
        "stored.T if file.userblock_size else stored",
        "stored",
        "order of MATLAB's axes",
        "logs/test_log_archives.py",
    ),
    Fault(
        "logs/files/csv_file.py",
        "int(second) - east",
        "int(second) + east",
        "time zones",
        "logs/test_log_text.py",
    ),
    Fault(
        "formats/robot_sources.py",
        "pitch = atan2(-R[2, 0]",
        "pitch = atan2(R[2, 0]",
        "angles of Pinocchio's frames",
        "formats/test_robot_sources.py",
    ),
    Fault("logs/columns/units.py", '"deg": _Unit(_PI / 180', '"deg": _Unit(_PI / 200', "degrees", UNITS),
    Fault("logs/columns/units.py", "sign = -1 if operator", "sign = 1 if operator", "quotients of units", UNITS),
    Fault(
        "logs/columns/conversion.py",
        "* values + channel.offset)",
        "* values - channel.offset)",
        "offsets of clocks",
        "logs/test_log_topics.py",
    ),
    Fault(
        "logs/columns/conversion.py",
        "found[wide & ~exact] = np.nan",
        "found[wide & exact] = np.nan",
        "pauses of a slower clock",
        "logs/test_log_topics.py",
    ),
    Fault(
        "logs/files/csv_file.py",
        'text = text.replace(b",", b".")',
        'text = text.replace(b",", b"")',
        "decimal commas",
        "logs/test_log_text.py logs/test_log_files.py",
    ),
    Fault(
        "logs/files/csv_file.py",
        "self._dialect.start + 1",
        "self._dialect.start",
        "numbers of lines in messages",
        "logs/test_log_text.py logs/test_log_files.py",
    ),
    Fault(
        "logs/preparation/states.py",
        "qdd = from_velocity",
        "qdd = qdd",
        "accelerations from measured velocities",
        "signals/test_prepare.py",
    ),
    Fault(
        "logs/preparation/segments.py",
        "* rate) + 1)",
        "* rate))",
        "samples that a stretch keeps",
        "signals/test_prepare.py logs/test_clock.py",
    ),
    Fault(
        "signals/filters.py",
        "np.abs(self._residues()) / (1 - size)",
        "np.abs(self._residues()) / (1 + size)",
        "how far a filter reaches",
        FILTERS,
    ),
    Fault("signals/filters.py", "2.285 * 2 * np.pi", "2.285 * 4 * np.pi", "length of a filter", FILTERS),
    Fault(
        "signals/filters.py",
        "first * self.factor - self.reach",
        "first * self.factor - self.reach + 1",
        "a filter without delay",
        FILTERS,
    ),
    Fault(
        "signals/derivatives.py", "w * sines, -w * cosines", "w * sines, w * cosines", "derivatives of sines", SIGNALS
    ),
    Fault(
        "signals/derivatives.py",
        "2 * second[:, 1:] - growth * omega",
        "2 * second[:, 1:]",
        "angular accelerations of quaternions",
        SIGNALS,
    ),
    Fault("signals/clock.py", "if off > _COARSE * median or", "if", "the period of coarse stamps", CLOCK),
    Fault(
        "signals/clock.py",
        "np.sinc(places - rest)",
        "np.sinc(places + rest)",
        "shifts by parts of a sample",
        SIGNALS,
    ),
    Fault(
        "signals/periods.py",
        "0.5 * (before - after)",
        "0.5 * (after - before)",
        "periods between samples",
        SIGNALS,
    ),
    Fault("signals/spectrum.py", "step = 2 * np.sin(", "step = np.sin(", "power of positions", SIGNALS),
    Fault("setup/columns.py", '{"n": i + 1, "i": i', '{"n": i, "i": i', "numbers in names of columns", SETUP),
    Fault(
        "setup/columns.py",
        "{**known_values(mechanism), PI: math.pi}",
        "known_values(mechanism)",
        "π in scales",
        f"{SETUP} identification/test_gains.py",
    ),
    Fault("setup/setup.py", 'f"log[{k}]" if listed', 'f"log[0]" if listed', "which log an error is about", SETUP),
    Fault(
        "setup/setup.py",
        "replace(options, friction=True)",
        "options",
        "friction of bare robot files",
        f"{SETUP} identification/test_synthetic_files.py",
    ),
)
