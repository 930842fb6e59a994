"""Plain array code traced into tapes of single operations, and tapes into machine code and C."""
