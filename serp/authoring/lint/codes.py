"""The codes of findings; docs/reference/checks.md has an example of each."""

from __future__ import annotations

ERRORS = {
    "contradictory-effects": "Two effects would have to happen at once and cannot.",
    "foreign-syntax": "A form of another language, or another order of words.",
    "malformed": "A form has too many or too few parts, or parts of another kind.",
    "math-functions": "A function of numbers that the file does not ask for, or that is unknown.",
    "missing-domain": "The file of the domain that a problem belongs to is not found.",
    "no-result": "A number that is never defined, such as a division by zero.",
    "reserved-name": "`reward`, `unsafe`, `terminal` or a word of PDDL is used as it cannot be.",
    "stray-text": "Characters that are not part of PDDL.",
    "too-large": "Too many instances, fluents or operations.",
    "type-conflict": "Types that are their own ancestors, or several where there can be one.",
    "unbalanced-parentheses": "A parenthesis is missing, or one too many.",
    "unknown-name": "A predicate, function, object, type or variable that is not declared.",
    "unknown-section": "There is no such section of a file, or field of an action.",
    "unreadable-file": "A file cannot be read.",
    "unsupported": "PDDL that SErP does not support, and what to write instead.",
    "wrong-arguments": "Too many or too few arguments, or one of another type.",
    "wrong-kind": "A predicate where a function belongs, a condition where an effect does.",
}
"""Code → meaning; no comment silences an error."""
WARNINGS = {
    "always-true": "A condition holds in every state.",
    "always-unsafe": "An action is unsafe wherever it can be applied, or an event always fires.",
    "assigned-twice": "One list of effects sets a function to two numbers.",
    "contradictory-condition": "A condition that can never hold.",
    "dead-effect": "An effect under a `when` that can never hold.",
    "declared-twice": "A second declaration; an error where it differs from the first.",
    "double-negative": "A decrease by a negative number, or an increase by one.",
    "flag-read-in-action": "An action reads a flag, which it always finds false.",
    "frozen-fluent": "An event waits for a number that nothing changes.",
    "missing-value": "A number, field or initial value is missing; an error where it is needed.",
    "needless": "Something that can be left out.",
    "never-read": "A function or predicate that effects change, and nothing reads.",
    "no-action": "There is nothing to plan with.",
    "no-change": "An effect changes nothing.",
    "no-reward": "Nothing changes the reward.",
    "not-portable": "Other PDDL tools do not read this.",
    "nothing-unsafe": "No action will ever be refused.",
    "one-way": "A number only ever moves away from a limit.",
    "other-domain": "The problem names another domain.",
    "out-of-range": "A number far outside what the task observes.",
    "same-schema": "Two actions, processes or events say the same.",
    "schema-without-use": "An action, process or event has no instance, or changes nothing.",
    "set-and-unset": "One list of effects makes a predicate both true and false.",
    "task-mismatch": "The task that the file belongs to does not fit it.",
    "unbounded-goal": "Nothing bounds what the metric gains in a step.",
    "unknown-requirement": "A requirement that SErP does not know.",
    "unused-name": "A predicate or function that nothing changes or reads.",
    "unused-parameter": "A parameter that nothing reads.",
    "useless-silence": "A comment that silences nothing.",
}
"""Code → meaning."""
NOTES = frozenset(("not-portable", "nothing-unsafe"))
"""Warnings that are true of many a file which is as it should be; they are shown as notes."""
CODES = {**ERRORS, **WARNINGS}
"""Code → meaning, of all findings."""
