"""The equations of an arm as C: expressions, their code, and the files."""
