-- Makes and ends subscriptions without a pause.
-- expect: cpu
while true do
	local one = robot.on("frame", function() end)
	one:off()
	one:off()
	robot.once("audio", function() end):off()
end
