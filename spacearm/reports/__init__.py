"""Design reports: what is known of an arm, on one page that opens and prints anywhere."""
