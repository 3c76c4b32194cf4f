-- A handler that is called where it should be handed over.
-- expect: check 6: robot.on: the function must be a function, got nothing
local function home()
	print("home")
end
robot.on("docked", home())
