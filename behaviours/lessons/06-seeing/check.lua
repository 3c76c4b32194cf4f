-- Lesson 6: points at the ball.

local BALL = { left = { x = 2.6, y = 1.9 }, right = { x = 2.6, y = 1.1 } }
local OTHER = { left = "right", right = "left" }

local function points(sim, side)
	sim:place_ball(1, BALL[side])
	local lit = sim:wait_until(function() return sim:leds()[side] end, 6)
	expect(lit or not sim:leds()[OTHER[side]], `The ball is to the {side}, but the {OTHER[side]} light is on instead of the {side} one.`)
	expect(lit, `The ball is to the {side}, but the {side} light is off.`)
	local alone = sim:wait_until(function() return not sim:leds()[OTHER[side]] end, 2)
	expect(alone, `The ball is to the {side}, but the {OTHER[side]} light is on too.`)
	sim:wait(1)
	expect(sim:leds()[side], `The ball is still to the {side}, but the {side} light has gone off.`)
end

scenario("A ball to the left", { world = "yard", points = 3, seeds = 2, limit = 30 }, function(sim)
	sim:place_ball(1, BALL.left)
	sim:run()
	points(sim, "left")
end)

scenario("The ball goes to the right", { world = "yard", points = 3, seeds = 2, limit = 40 }, function(sim)
	sim:place_ball(1, BALL.left)
	sim:run()
	sim:wait(2)
	points(sim, "right")
end)

scenario("The ball goes away", { world = "yard", points = 4, seeds = 2, limit = 40 }, function(sim)
	sim:place_ball(1, BALL.right)
	sim:run()
	points(sim, "right")
	sim:place_ball(1, { x = 0.4, y = 0.4 })
	local dark = sim:wait_until(function() return not sim:leds().left and not sim:leds().right end, 6)
	expect(dark, "The ball is no longer in sight, but a light is still on.")
end)
