"""What ``mavsentry bench detect`` does: how small a fault is found, how soon, at which price.

==============  ====================================================================================
flights         synthetic flights of three airframe classes and recorded ones, decoded once
configurations  which sensors an aircraft carries, and what is broken in them, by how much
trials          a fault injected into a flight at a moment, and what the pipeline says of it
search          smallest size found, level by level; bounds on shares and rates
processes       tasks over processes
campaign        all of it over processes, resumable
table           the outcome as JSON, Markdown and on the terminal
curves          delay against size as an SVG picture
command         what is typed
==============  ====================================================================================
"""
