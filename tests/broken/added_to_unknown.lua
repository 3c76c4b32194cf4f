-- Something is added to a variable that was never made.
-- expect: check 4: unknown name 'rounds'
while true do
	rounds += 1
	task.wait(1)
end
