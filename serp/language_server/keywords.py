"""The words of PDDL, and what each means in one step."""

from __future__ import annotations

from serp.pddl.scope import INSTEAD, REQUIREMENTS_INSTEAD

_REFUSED = {**INSTEAD, **REQUIREMENTS_INSTEAD}
MEANINGS = {
    **{
        word: f"Not supported: {instead}."
        for word, instead in _REFUSED.items()
        if word.startswith(":") or word in ("oneof", "probabilistic", "preference")
    },
    "define": "A file holds one definition: a domain, or a problem of it.",
    "domain": "The name of the domain; the task of the same name belongs to it.",
    "problem": "The name of the problem.",
    ":requirements": "What other PDDL tools have to support to read the file.",
    ":types": "Kinds of objects: `cup plate - dish` are two kinds of dishes.",
    ":constants": "Objects that every problem has.",
    ":predicates": "What is true or false.",
    ":functions": "What has a number.",
    ":action": "What the robot can do. One action is carried out in each step.",
    ":process": "What the world does by itself: while its condition holds, it changes numbers at a "
    "rate, after the action of each step.",
    ":event": "What happens at a point: once in a step, as soon as its condition holds, after "
    "action and processes.",
    ":parameters": "The objects that it is about; there is an instance for each choice of them.",
    ":precondition": "When it can happen. An action whose precondition does not hold is not "
    "applicable.",
    ":effect": "What it changes. All effects are evaluated before any of them is made.",
    ":domain": "The domain that the problem belongs to.",
    ":objects": "The objects of the problem.",
    ":init": "The state at the start; what is not stated is false.",
    ":goal": "Where this holds, the task ends.",
    ":metric": "What is to be maximised or minimised; `(reward)` by default.",
    "and": "All of these hold, or happen.",
    "or": "At least one of these holds.",
    "not": "This does not hold; as an effect, it becomes false.",
    "imply": "Where the first holds, so does the second.",
    "forall": "For every object of a type.",
    "exists": "For at least one object of a type.",
    "when": "An effect that happens only where a condition holds before the step.",
    "assign": "Sets a function to a number.",
    "increase": "Adds a number to a function; in a process, a rate: `(* #t rate)`.",
    "decrease": "Takes a number from a function; in a process, a rate: `(* #t rate)`.",
    "scale-up": "Multiplies a function by a number.",
    "scale-down": "Divides a function by a number.",
    "either": "One of several types.",
    "#t": "The time that passes in a step; a factor of a rate in a process.",
    "reward": "Reserved: what it gains in a step is the reward of the step.",
    "unsafe": "Reserved: what makes it true damages something, and is avoided as long as anything "
    "else is possible. It is false again in the next step.",
    "terminal": "Reserved: what makes it true ends the task.",
    "+": "The sum of two numbers.",
    "-": "A difference; in lists, the type of what stands before it.",
    "*": "The product of two numbers.",
    "/": "A quotient.",
    "=": "Two numbers, or two objects, are equal.",
    "<": "Less than.",
    "<=": "At most.",
    ">": "More than.",
    ">=": "At least.",
    "sqrt": "The root of a number.",
    "abs": "A number without its sign.",
    "min": "The least of some numbers.",
    "max": "The greatest of some numbers.",
    "sin": "The sine of an angle in radians.",
    "cos": "The cosine of an angle in radians.",
    "atan2": "The angle, in radians, of a point with coordinates y and x.",
    "object": "The type that all objects have.",
    "number": "What functions have; it need not be written.",
    "minimize": "What it loses in a step is the reward of the step.",
    "maximize": "What it gains in a step is the reward of the step.",
    "total-time": "The time since the start; a metric can read it.",
    ":strips": "The file has predicates, and effects on them.",
    ":typing": "The file gives types to objects and parameters.",
    ":equality": "The file compares objects: `(= ?a ?b)`.",
    ":negative-preconditions": "The file has conditions with `not`.",
    ":disjunctive-preconditions": "The file has conditions with `or` or `imply`.",
    ":existential-preconditions": "The file has conditions with `exists`.",
    ":universal-preconditions": "The file has conditions with `forall`.",
    ":quantified-preconditions": "The file has conditions with `exists` or `forall`.",
    ":conditional-effects": "The file has effects under `when` or `forall`.",
    ":adl": "The file has types, conditions of every kind, and conditional effects.",
    **dict.fromkeys((":fluents", ":numeric-fluents"), "The file has functions of numbers."),
    ":action-costs": "The file has functions of numbers that are increased only, as costs.",
    **dict.fromkeys(
        (":time", ":hybrid", ":continuous-effects"), "The file has processes, or events."
    ),
    ":processes": "The file has processes.",
    ":events": "The file has events.",
    ":math-functions": "The file has `sqrt`, `sin` and the like, which other PDDL tools refuse.",
}
"""Word → its meaning."""

SECTIONS = (":requirements", ":types", ":constants", ":predicates", ":functions",
            ":action", ":process", ":event", ":domain", ":objects", ":init", ":goal",
            ":metric")  # fmt: skip
FIELDS = (":parameters", ":precondition", ":effect")
COMPARISONS = ("=", "<", "<=", ">", ">=")
CONDITIONS = ("and", "or", "not", "imply", "forall", "exists", *COMPARISONS)
CHANGES = ("assign", "increase", "decrease", "scale-up", "scale-down")
EFFECTS = ("and", "not", "when", "forall", *CHANGES)
NUMBERS = ("+", "-", "*", "/")
OF_NUMBERS = (*COMPARISONS, *CHANGES, *NUMBERS)
"""What numbers stand behind."""
REQUIREMENTS = (":strips", ":typing", ":equality", ":adl", ":conditional-effects",
                ":negative-preconditions", ":disjunctive-preconditions", ":numeric-fluents",
                ":time", ":math-functions")  # fmt: skip
