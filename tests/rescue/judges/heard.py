import sys,re,math,collections
sys.path.insert(0,'.')
tot=0;bad=0;lostheard=0;lost=0;runs=0;rows=[]
for fn in sys.argv[1:]:
    Y={};by=collections.OrderedDict()
    for l in open(fn):
        w=l.split(None,5)
        if not w: continue
        if w[0]=='Y': Y[w[1]]=l
        elif w[0] in 'EP' and len(w)>3: by.setdefault(w[1],[]).append(l)
    for k,ls in by.items():
        l=Y[k];parts=l.split(' || ')
        W=float(re.search(r'width: ([\d.]+)',parts[0])[1]);D=float(re.search(r'depth: ([\d.]+)',parts[0])[1])
        segs=[]
        for m in re.finditer(r'from: Spot\(\[Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)\]\), to: Spot\(\[Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)\]\), thickness: ([\d.]+)',parts[1]):
            segs.append(tuple(map(float,m.groups()[:4])))
        for m in re.finditer(r'Furniture \{ at: Spot\(\[Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)\]\), length: ([\d.]+), width: ([\d.]+), height: ([\d.]+), heading_degrees: ([-\d.]+)',l):
            x,y,L,Wd,H,h=map(float,m.groups());h=math.radians(h);c,s=math.cos(h),math.sin(h)
            Q=[(x+c*a*L/2-s*b*Wd/2,y+s*a*L/2+c*b*Wd/2) for a,b in ((-1,-1),(1,-1),(1,1),(-1,1))]
            for i in range(4): segs.append(Q[i]+Q[(i+1)%4])
        sx,sy,sh=map(float,re.search(r'Station \{ at: Spot\(\[Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)\]\), heading_degrees: ([-\d.]+)',l).groups())
        h=math.radians(sh);bx,by_=sx+.1*math.cos(h),sy+.1*math.sin(h)
        def hears(x,y):
            d=math.hypot(x-bx,y-by_);off=abs((math.atan2(y-by_,x-bx)-h+math.pi)%(2*math.pi)-math.pi)
            if d>4 or off>math.radians(70): return False
            for x1,y1,x2,y2 in segs:
                ex,ey=x2-x1,y2-y1;dx,dy=x-bx,y-by_;den=dx*ey-dy*ex
                if abs(den)<1e-9: continue
                t=((x1-bx)*ey-(y1-by_)*ex)/den;u=((x1-bx)*dy-(y1-by_)*dx)/den
                if 0<t<1 and 0<=u<=1: return False
            return True
        pos=None;ev=[];bat=9
        for l in ls:
            w=l.split(None,4)
            if w[0]=='P': pos=tuple(map(float,l.split()[3:5]));bat=float(l.split()[6])
            elif 'Engine(Dock)' in l and w[3]=='Heard' and pos: ev.append((float(w[2]),hears(*pos),pos))
        n=sum(h for _,h,_ in ev);runs+=1
        isl=bat<.5;lost+=isl
        tot+=n;bad+=max(0,n-(0 if isl else 1));lostheard+=isl and n>0
        if n-(0 if isl else 1)>0: rows.append((k[-6:],'LOST' if isl else 'home',[ (round(t),h) for t,h,_ in ev]))
print('runs',runs,'lost',lost,'searches within hearing',tot,'in vain',bad,'lost robots that were within hearing',lostheard)
for r in rows[:30]: print(*r)
