-- An end that closes nothing.
-- expect: check 6: this `end` closes nothing: there is one too many
if robot.docked() then
	print("home")
end
end
