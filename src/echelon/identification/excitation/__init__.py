"""Excitation: what data show of the parameters, and which motions would show more."""
