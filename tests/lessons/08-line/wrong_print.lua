-- wrong: It does not follow the line at all
robot.on("frame", function(frame)
	local line = frame:find_line("black", { roi = { 0, 200, 320, 40 } })
	if line then
		print("line at", line.offset)
	else
		print("no line")
	end
end)
