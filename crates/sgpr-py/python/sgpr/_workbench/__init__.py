"""The workbench: a local page that compares models, shows where they fail, and adds what is missing.

folder.py      robot, logs and the project file beside them
steps.py       models as steps that can be added, taken back and branched
bench.py       what is open, and every change of it
logs.py        what was read, and what the checks and the physics say of it
models.py      models of all steps, from the cache if nothing has changed; their torque and errors
missing.py     what the models lack
remedies.py    what messages about a log propose, as a click
motions.py     the next experiment, as plot and file
memory.py      what is free goes back to the system
work.py        one piece of long work at a time, with progress and cancel
tracks.py      the torque of a log and of every model, thinned to what a screen shows
residuals.py   the residual against anything, its spectrum, and what is different in a picked region
takeaway.py    model, report, commands and script that repeat it
guard.py       who may talk to the server
server.py      addresses of the page;  running.py: from start to end
page/          the page itself
"""
