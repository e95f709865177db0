"""The run folder: everything that one training leaves behind, in open formats.

``folder``      a run on the disk: create, open, continue
``placement``   where a new run goes
``config``      what was asked for and on what it ran
``lock``        one process at a time
``checkpoint``  the training state: safetensors and JSON in one file, digest inside
``rows``        the columns of ``metrics.csv`` and ``decisions.csv``
``tables``      appends to those tables
``reading``     reads them
``summary``     what a reader wants first, as JSON
``plots``       the learning curve
``report``      the same for people, as Markdown
``results``     writes the last three into a run
``json_files``  JSON for people and other programs
``durable``     writes a file so that a crash leaves the old one or the new one
"""
