"""What really happens: missions, trajectories and the instruments that observe them."""
