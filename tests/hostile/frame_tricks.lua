-- Analyses frames with the most expensive arguments, and saves to forbidden paths.
-- expect: cpu error done memory
local frame = robot.wait_frame(5)
for _, name in { "/etc/passwd", "../other.jpg", "a/b.jpg", ".", "", ("x"):rep(300), "nul\0.jpg", "\27[2J.jpg" } do
	local ok, path = pcall(frame.save, frame, name)
	if ok and path and (path:find("..", 1, true) or path:find("passwd", 1, true)) then
		error("saved at " .. path)
	end
end
for _, n in { 0 / 0, 1 / 0, -1 / 0, 1e308, -1e9, 5e-324, -0 } do
	pcall(frame.get_pixel, frame, n, n)
	pcall(frame.brightness, frame, { n, n, n, n })
	pcall(frame.sharpness, frame, { x = n, y = n, w = n, h = n })
	pcall(vision.lab, { l = { n, n }, a = { n, n }, b = { n, n } })
	pcall(vision.hsv, { h = { n, n }, s = { n, n }, v = { n, n } })
	pcall(vision.tracker, { colour = "red", min_age = n, max_lost = n, max_jump = n })
	pcall(vision.motion, { threshold = n, min_pixels = n })
	pcall(frame.find_blobs, frame, "red", { margin = n, max_blobs = n, area_threshold = n, pixels_threshold = n })
end
local colours = table.create(10000, "red")
pcall(frame.find_blobs, frame, colours)
pcall(vision.learn, table.create(10000, frame), { 0, 0, 320, 240 })
while true do
	pcall(frame.find_blobs, frame, { "white", "black", "red", "green" }, { merge = true, margin = 320, area_threshold = 1, pixels_threshold = 1, max_blobs = 1000 })
	pcall(frame.find_qrcodes, frame)
end
