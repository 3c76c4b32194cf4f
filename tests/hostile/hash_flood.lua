-- A hundred thousand strings with the same hash: each lookup passes all earlier ones, in C.
-- expect: cpu memory
local last = (
	"aq2M @r2M #s2M @Q3M aR3M #T3M =u3M ^v3M |{3M #14M a34M @44M ^W4M =X4M |Z4M =75M "
	.. "^85M |95M ^wOQ =xOQ |~OQ =WPQ ^XPQ |]PQ @cPQ adPQ #fPQ ^9QQ =:QQ |<QQ #CQQ aEQQ "
	.. "@FQQ #$RQ @%RQ a&RQ =W/R ^X/R |]/R @c/R ad/R #f/R ^w0R =x0R |~0R #$1R @%1R a&1R "
	.. "^92R =:2R |<2R #C2R aE2R @F2R #1wS a3wS @4wS ^WwS =XwS |ZwS =7xS ^8xS |9xS aqyS "
	.. "@ryS #syS @QzS aRzS #TzS =uzS ^vzS |{zS =7WT ^8WT |9WT #1XT a3XT @4XT ^WXT =XXT "
	.. "|ZXT @QYT aRYT #TYT =uYT ^vYT |{YT aqZT @rZT #sZT #$tX @%tX a&tX ^9uX =:uX |<uX "
	.. "#CuX aEuX @FuX =WvX ^XvX |]vX @cvX advX #fvX ^wwX =xwX |~wX"
):split(" ")
local middle = (
	"%0xF c2xF D3xF DPyF cQyF %SyF cpzF DqzF %rzF DP:H cQ:H %S:H cp;H Dq;H %r;H %0=H "
	.. "c2=H D3=H cpZI DqZI %rZI DP[I cQ[I %S[I *$tR I%tR h&tR U9uR 6:uR u<uR *CuR hEuR "
	.. "IFuR 6WvR UXvR u]vR IcvR hdvR *fvR UwwR 6xwR u~wR 6W/T UX/T u]/T Ic/T hd/T *f/T "
	.. "Uw0T 6x0T u~0T *$1T I%1T h&1T U92T 6:2T u<2T *C2T hE2T IF2T UwOU 6xOU u~OU 6WPU "
	.. "UXPU u]PU IcPU hdPU *fPU U9QU 6:QU u<QU *CQU hEQU IFQU *$RU I%RU h&RU 67WV U8WV "
	.. "u9WV *1XV h3XV I4XV UWXV 6XXV uZXV IQYV hRYV *TYV 6uYV UvYV u{YV hqZV IrZV *sZV "
	.. "*1wW h3wW I4wW UWwW 6XwW uZwW 67xW U8xW u9xW hqyW IryW *syW IQzW hRzW *TzW 6uzW "
	.. "UvzW u{zW hq2Y Ir2Y *s2Y IQ3Y hR3Y *T3Y 6u3Y Uv3Y u{3Y *14Y h34Y I44Y UW4Y 6X4Y "
	.. "uZ4Y 675Y U85Y u95Y"
):split(" ")
local first = (
	"(&gQ f(gQ E)gQ EFhQ fGhQ (IhQ ffiQ EgiQ (hiQ #=kQ a?kQ @@kQ pAkQ OBkQ @]lQ a^lQ "
	.. "#`lQ OclQ pdlQ a}mQ @~mQ a}ER @~ER @]FR a^FR #`FR OcFR pdFR #=GR a?GR @@GR pAGR "
	.. "OBGR ffIR EgIR (hIR EFJR fGJR (IJR (&KR f(KR E)KR @]%S a^%S #`%S Oc%S pd%S a}&S "
	.. "@~&S #=(S a?(S @@(S pA(S OB(S EF)S fG)S (I)S ff*S Eg*S (h*S @#}S a$}S #&}S p9~S "
	.. "O:~S aC~S @D~S #E~S p9_T O:_T aC_T @D_T #E_T @#`T a$`T #&`T p|aT O}aT p]bT #abT "
	.. "@bbT acbT @#?U a$?U #&?U p9@U O:@U aC@U @D@U #E@U p]AU #aAU @bAU acAU p|BU O}BU "
	.. "p|&f O}&f p9(f O:(f aC(f @D(f #E(f @#)f a$)f #&)f"
):split(" ")
local start = "/?H-fL:D]|%U8Rh:"

-- First many in one call, then through split.
local parts = {}
for _, a in first do
	for _, b in middle do
		for _, c in last do
			parts[#parts + 1] = start .. a .. b .. c
			if #parts == 7000 then
				local text = table.concat(parts)
				pcall(string.unpack, ("c28"):rep(7000), text)
				pcall(string.split, table.concat(parts, ","), ",")
			end
		end
	end
end
