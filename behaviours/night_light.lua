-- night_light: switches the lights on when it gets dark, and off when it gets bright. It does not
-- drive. Its own headlight would disturb the measurement, so it is switched off for each look.
-- How bright the same lamp makes a picture depends on what the robot looks at, so it also compares each
-- look with the brightest of the day, or the darkest of the night. Between the limits of night and day
-- there is a gap, so that the lights do not flicker at dusk.

local settings = params.declare({
	dark = { default = 0.12, min = 0, max = 1, doc = "a picture darker than this is night (0 black, 1 white)" },
	bright = { default = 0.33, min = 0, max = 1, doc = "a picture brighter than this is day; between them, one much darker than by day is night, one much brighter than at night is day" },
	pause = { default = 8, min = 1, max = 600, unit = "s", doc = "time between two looks" },
})
assert(settings.dark < settings.bright, "dark must be less than bright")

local BLINK = 1.5 -- seconds that the camera needs to adjust to the light
local FALL, RISE = 0.6, 1.6 -- much darker than by day, much brighter than at night: shares

local shining = store.get("shining", false)
local nights = store.get("nights", 0)
local extreme = store.get("extreme", nil) -- brightness of the brightest look of the day, or the darkest of the night

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

local function is_night(brightness)
	return brightness < settings.dark or brightness < math.min(settings.bright, FALL * extreme)
end

local function is_day(brightness)
	return brightness > settings.bright or brightness > RISE * math.max(settings.dark, extreme)
end

local function remember(brightness)
	if brightness ~= extreme then
		extreme = brightness
		store.set("extreme", extreme)
	end
end

local function judge(brightness)
	extreme = extreme or brightness
	if not shining and is_night(brightness) then
		nights += 1
		store.set("nights", nights)
		log.info(`night {nights}`, { brightness = brightness })
		remember(brightness)
		shine(true)
	elseif shining and is_day(brightness) then
		log.info("day", { brightness = brightness })
		remember(brightness)
		shine(false)
	else
		remember(if shining then math.min(extreme, brightness) else math.max(extreme, brightness))
	end
end

shine(shining)
while true do
	local brightness = look()
	if brightness then
		judge(brightness)
	else
		log.warn("the camera sent no picture")
	end
	task.wait(settings.pause)
end
