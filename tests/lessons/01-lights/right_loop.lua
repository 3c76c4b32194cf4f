-- right
for _, side in { "left", "right" } do
	robot.blink(side, { on = 1, off = 0.1, count = 1 }):join()
end
