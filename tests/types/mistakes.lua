-- Each line that ends so must have a type error, with both solvers.
robot.on("frame", function(frame: Frame)
	print(frame.nope) -- wrong
end)
robot.on("fraem", function() end) -- wrong
robot.move("x", 1) -- wrong
robot.moev(1, 1) -- wrong
robot.led("middle", true) -- wrong
os.execute("ls") -- wrong
local easy = require("@spykee/easy")
easy.lihgt("left") -- wrong
local level: number = robot.battery() -- wrong
print(level)
