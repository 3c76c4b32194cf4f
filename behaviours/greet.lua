-- greet: stands still and greets people with light and sound: anybody who shows it a QR code, with
-- the text of the code, and anything as large as a person that walks by. There is a pause between
-- two greetings, and the same code is not greeted again for a long time. The store counts the
-- guests.

local settings = params.declare({
	pause = { default = 30, min = 1, max = 3600, unit = "s", doc = "the shortest time between two greetings" },
	again = { default = 600, min = 1, max = 86400, unit = "s", doc = "the same code is greeted again after this" },
	tall = { default = 0.3, min = 0.05, max = 1, doc = "something that moves counts as a person from this share of the picture's height on" },
})

local detector = vision.motion()
local last = -math.huge
local greeted = {} -- when each code was greeted
local guests = store.get("guests", 0)

local function greet(whom)
	last = task.now()
	guests += 1
	store.set("guests", guests)
	log.info(`hello, {whom}!`, { guest = guests })
	robot.play("robot")
	robot.blink("all", { on = 0.2, off = 0.2, count = 3 })
end

local function new_code(frame)
	for _, code in frame:find_qrcodes() do
		if task.now() - (greeted[code.text] or -math.huge) > settings.again then
			greeted[code.text] = task.now()
			return code.text
		end
	end
	return nil
end

local function person(frame, motion)
	for _, blob in motion.blobs do
		if blob.h > settings.tall * frame.height then
			return true
		end
	end
	return false
end

robot.on("frame", function(frame)
	-- The detector needs every frame, because it compares each frame with the one before.
	local motion = detector:update(frame)
	if task.now() - last < settings.pause then
		return
	end
	local name = new_code(frame)
	if name then
		greet(name)
	elseif motion and person(frame, motion) then
		greet("stranger")
	end
end, { rate = 5 })
