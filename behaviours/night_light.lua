-- night_light: when it gets dark it puts the lights on, when it gets bright it puts them off. It does
-- not drive. Its own headlight would outshine what it measures, so it shuts that for each look, and
-- between night and day there is a gap, so that dusk does not make it flicker.

local settings = params.declare({
	dark = { default = 0.25, min = 0, max = 1, doc = "a picture darker than this is night (0 black, 1 white)" },
	bright = { default = 0.33, min = 0, max = 1, doc = "a picture brighter than this is day" },
	pause = { default = 8, min = 1, max = 600, unit = "s", doc = "between two looks" },
})
assert(settings.dark < settings.bright, "dark must be less than bright")

local BLINK = 1.5 -- seconds that the camera needs to get used to the light

local shining = store.get("shining", false)
local nights = store.get("nights", 0)

local function shine(on)
	shining = on
	robot.led("all", on)
	store.set("shining", on)
end

-- How bright it is without the headlight; nil without a picture.
local function look()
	robot.led("flash", false)
	robot.wait_frame(2) -- the camera is on now
	task.wait(BLINK)
	local frame = robot.wait_frame(2)
	robot.led("flash", shining)
	return frame and frame:brightness()
end

shine(shining)
while true do
	local brightness = look()
	if not brightness then
		log.warn("no picture: the camera is silent")
	elseif not shining and brightness < settings.dark then
		nights += 1
		store.set("nights", nights)
		log.info(`night {nights}`, { brightness = brightness })
		shine(true)
	elseif shining and brightness > settings.bright then
		log.info("day", { brightness = brightness })
		shine(false)
	end
	task.wait(settings.pause)
end
