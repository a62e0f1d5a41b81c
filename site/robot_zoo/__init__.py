"""The zoo: pages about many robots at once, with everything that Echelon derives for each."""
