-- goto of C.
-- expect: check 4: there is no goto
while true do
	goto done
end
