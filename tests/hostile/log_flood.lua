-- Writes log lines as fast as possible, with pauses that keep the script alive.
-- expect: done
local long = ("x"):rep(2000)
local begun = task.now()
while task.now() - begun < 0.2 do
	for _ = 1, 200 do
		print(long)
		log.error(long, { a = long, b = long, c = { long, long } })
	end
	task.wait()
end
