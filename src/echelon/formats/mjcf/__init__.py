"""The reader of MJCF, the XML format of MuJoCo."""
