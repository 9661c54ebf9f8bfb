"""The workbench: a local page that compares models, shows where they fail, and adds what is missing.

folder.py      robot, logs and the project file beside them
steps.py       models as steps that can be added, taken back and branched
bench.py       what is open: logs, steps, errors, candidates; every change of it
remedies.py    what messages about a log propose, as a click
motions.py     the next experiment, as plot and file
work.py        one piece of long work at a time, with progress and cancel
tracks.py      the torque of a log and of every model, thinned to what a screen shows
residuals.py   the residual against anything, its spectrum, and what is different in a picked region
takeaway.py    model, report, commands and script that repeat it
guard.py       who may talk to the server
server.py      addresses of the page;  running.py: from start to end
page/          the page itself
"""
