"""Plans with momentum on board: the spacecraft drifts while the arm moves."""
