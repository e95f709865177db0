"""Bytecode: models too large to be compiled, executed by one compiled loop."""
