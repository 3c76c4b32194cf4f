# for each search: does the beacon reach the robot (4 m, 70 degrees off its axis, walls and furniture hide it)?
import sys,re,math,collections
order=[];by=collections.defaultdict(list);Y={}
for l in open(sys.argv[1]):
    w=l.split(None,3)
    if w and w[0]=='Y': Y[w[1]]=l; continue
    if w and w[0] in 'EP':
        if w[1] not in by: order.append(w[1])
        by[w[1]].append(l)
def geo(l):
    parts=l.split(' || ')
    segs=[]
    for m in re.finditer(r'from: Spot\(\[Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)\]\), to: Spot\(\[Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)\]\)',parts[1]):
        segs.append(tuple(map(float,m.groups())))
    nw=len(segs)
    for m in re.finditer(r'Furniture \{ at: Spot\(\[Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)\]\), length: ([\d.]+), width: ([\d.]+), height: ([\d.]+), heading_degrees: ([-\d.]+)',l):
        x,y,L,W,H,h=map(float,m.groups());h=math.radians(h);c,s=math.cos(h),math.sin(h)
        P=[(x+c*a*L/2-s*b*W/2,y+s*a*L/2+c*b*W/2) for a,b in ((-1,-1),(1,-1),(1,1),(-1,1))]
        for i in range(4): segs.append(P[i]+P[(i+1)%4])
    st=re.search(r'Station \{ at: Spot\(\[Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)\]\), heading_degrees: ([-\d.]+)',l)
    return segs,nw,tuple(map(float,st.groups()))
def cross(p,q,s):
    x1,y1,x2,y2=s;dx,dy=q[0]-p[0],q[1]-p[1];ex,ey=x2-x1,y2-y1;den=dx*ey-dy*ex
    if abs(den)<1e-9: return False
    t=((x1-p[0])*ey-(y1-p[1])*ex)/den;u=((x1-p[0])*dy-(y1-p[1])*dx)/den
    return 0<t<1 and 0<=u<=1
for k in order:
    ls=by[k];segs,nw,(sx,sy,sh)=geo(Y[k]);a=math.radians(sh);b=(sx+.2*math.cos(a),sy+.2*math.sin(a));pos=None;bat=9;o=[]
    for l in ls:
        w=l.split(None,4)
        if w[0]=='P': pos=tuple(map(float,l.split()[3:5]));bat=float(l.split()[6])
        elif 'Engine(Dock)' in l and w[3]=='Heard' and pos:
            d=math.dist(pos,b);off=abs((math.atan2(pos[1]-b[1],pos[0]-b[0])-a+math.pi)%(2*math.pi)-math.pi)*57.3
            wall=any(cross(pos,b,s) for s in segs[:nw]);furn=any(cross(pos,b,s) for s in segs[nw:])
            why=('w' if wall else '')+('f' if furn else '')+('d' if d>4 else '')+('a' if off>70 and d>.8 else '')
            o.append('%.1f%s'%(d,why or '!'))
    print(k[-6:],'LOST' if bat<.5 else 'home',len(o),' '.join(o))
