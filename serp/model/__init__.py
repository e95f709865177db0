"""The transition model of a domain file: instantiation, code generation, prediction."""
