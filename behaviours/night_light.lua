-- night_light: switches the lights on when it gets dark, and off when it gets bright. It does not
-- drive. Its own headlight would disturb the measurement, so it is switched off for each look.
-- There is a gap between the limits of night and day, so that the lights do not flicker at dusk.

local settings = params.declare({
	dark = { default = 0.25, min = 0, max = 1, doc = "a picture darker than this is night (0 black, 1 white)" },
	bright = { default = 0.33, min = 0, max = 1, doc = "a picture brighter than this is day" },
	pause = { default = 8, min = 1, max = 600, unit = "s", doc = "time between two looks" },
})
assert(settings.dark < settings.bright, "dark must be less than bright")

local BLINK = 1.5 -- seconds that the camera needs to adjust to the light

local shining = store.get("shining", false)
local nights = store.get("nights", 0)

local function shine(on)
	shining = on
	robot.led("all", on)
	store.set("shining", on)
end

-- Returns the brightness without the headlight; nil without a picture.
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
		log.warn("the camera sent no picture")
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
