-- guard: watches while the robot stands still. When something moves in front of the robot, or there
-- is a loud noise, it saves a photograph, sounds the alarm, writes a line to the log, and notifies
-- the targets of the config's `notify:`. It never drives, so it can run beside a patrol. It ignores
-- motion while anything moves the robot: the patrol, the watchdog, a person. A lamp that is
-- switched on does not count as an intruder. Without a microphone it only watches, without a camera
-- it only listens.

local settings = params.declare({
	pause = { default = 30, min = 1, max = 3600, unit = "s", doc = "the shortest time between two alarms" },
	alarm = { default = true, doc = "sound the alarm; otherwise only photograph and log" },
})

local detector = vision.motion()
local last = -settings.pause
local alarms = store.get("alarms", 0)

local function intruder(what, frame)
	if task.now() - last < settings.pause then
		return
	end
	last = task.now()
	alarms += 1
	store.set("alarms", alarms)
	if settings.alarm then
		robot.play("alarm")
	end
	local path, why
	if frame then
		-- The date keeps yesterday's pictures from being overwritten.
		path, why = frame:save(`alarm-{(string.gsub(clock.date().text, "%D", "-"))}.jpg`)
	end
	log.warn(`alarm {alarms}: {what}`, { picture = path or why or "none" })
	journal.add("intruder", { what = what, alarm = alarms })
	notify.send(what, { picture = path })
end

robot.on("frame", function(frame)
	local motion = detector:update(frame)
	if motion and #motion.blobs > 0 then
		intruder("something moves", frame)
	end
end, { rate = 5 })

robot.on("noise", function(noise)
	if noise.own then
		return -- its own motors, or its own speaker
	end
	intruder(`a noise of {math.round(noise.dbfs)} dBFS`, robot.frame())
end)
