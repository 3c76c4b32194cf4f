-- Blocks of C.
-- expect: check 3: '{' does not begin a block
if robot.docked() {
	print("home")
}
