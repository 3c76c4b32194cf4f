-- {{NAME}}: follows something red; looks around when it is out of sight.
--
-- Try it:  spykee run {{NAME}}.lua --sim
-- Another colour: see `colours:` in spykee.yaml.

local COLOUR = "red"
local NEAR = 90 -- pixels: as wide as this is close enough

robot.on("frame", function(frame)
	local blob = frame:find_blobs(COLOUR, { pixels_threshold = 25 })[1]
	if not blob then
		robot.drive(0, 0.7) -- metres a second, radians a second
	elseif blob.w < NEAR then
		robot.drive(0.2, 2 * blob.bearing)
	else
		robot.drive(0, 2 * blob.bearing)
	end
end)
