"""Files that are nearly right: every format, mutated at random, through the command line.

`make fuzz` runs ten thousand of them.  Whatever a file holds, a command ends with exit code 0, 1 or 2, within 20
seconds of the processor and 1 GB of memory.  A case is a format and a number; it can be run again alone.
"""
