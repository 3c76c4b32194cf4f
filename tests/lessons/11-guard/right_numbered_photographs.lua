-- right
local detector = vision.motion()
local last = -10
local count = 0
robot.on("frame", function(frame)
	local motion = detector:update(frame)
	if motion == nil then
		return
	end
	local moves = #motion.blobs >= 1
	local quiet = task.now() - last >= 10
	if moves and quiet then
		last = task.now()
		count += 1
		robot.play("alarm")
		frame:save(`intruder-{count % 20}.jpg`)
	end
end)
