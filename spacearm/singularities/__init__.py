"""Where a floating arm is singular: reports, exact and searched sets, maps, risks."""
