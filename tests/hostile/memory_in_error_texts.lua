-- Keeps the error texts of refused calls with long arguments: memory outside the VM.
-- expect: cpu memory
local keep, long = {}, ("x"):rep(100000)
while true do
	for _, call in { robot.play, robot.led, robot.on, robot.stream, robot.wait_for, robot.blink } do
		local _, text = pcall(call, long, long, long)
		keep[#keep + 1] = text
		_, text = pcall(call, { [long] = long }, { [long] = long }, { [long] = long })
		keep[#keep + 1] = text
	end
end
