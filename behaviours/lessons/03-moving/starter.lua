-- spykee lesson 3: moving
-- There and back: forwards for two seconds, a second of rest, and back to where it began.
-- Here it drives there. And back?

robot.move(40, 40, 2)
