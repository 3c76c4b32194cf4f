# true area newly in the beacon's range (4 m, line of sight) of each search, with the flat's true walls
import sys,re,math,collections
R=float(sys.argv[2]) if len(sys.argv)>2 else 3.0
order=[];by=collections.defaultdict(list);Y={}
for l in open(sys.argv[1]):
    w=l.split(None,3)
    if w and w[0]=='Y': Y[w[1]]=l; continue
    if w and w[0] in 'EP':
        if w[1] not in by: order.append(w[1])
        by[w[1]].append(l)
def geo(l):
    parts=l.split(' || ')
    room=parts[0]; W=float(re.search(r'width: ([\d.]+)',room)[1]);Dp=float(re.search(r'depth: ([\d.]+)',room)[1])
    segs=[]
    for m in re.finditer(r'from: Spot\(\[Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)\]\), to: Spot\(\[Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)\]\)',parts[1]):
        segs.append(tuple(map(float,m.groups())))
    for a in [(0,0,W,0),(W,0,W,Dp),(W,Dp,0,Dp),(0,Dp,0,0)]: segs.append(a)
    st=re.search(r'at: Spot\(\[Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)\]\)',parts[3])
    return W,Dp,segs,(float(st[1]),float(st[2])) if st else None
C=0.25
def seen(p,segs,W,Dp):
    out=set()
    for d in range(120):
        a=d*2*math.pi/120;dx,dy=math.cos(a),math.sin(a);r=R
        for x1,y1,x2,y2 in segs:
            ex,ey=x2-x1,y2-y1;den=dx*ey-dy*ex
            if abs(den)<1e-9: continue
            t=((x1-p[0])*ey-(y1-p[1])*ex)/den;u=((x1-p[0])*dy-(y1-p[1])*dx)/den
            if t>0 and 0<=u<=1 and t<r: r=t
        s=0
        while s<r:
            x,y=p[0]+s*dx,p[1]+s*dy
            out.add((int(x/C),int(y/C)));s+=C/2
    return out
tot=[0,0]
for k in order:
    ls=by[k];W,Dp,segs,st=geo(Y[k]);have=set();pos=None;bat=9;o=[];free=W*Dp
    allow=0
    for l in ls:
        w=l.split(None,4)
        if w[0]=='P': pos=tuple(map(float,l.split()[3:5]));bat=float(l.split()[6])
        elif 'Engine(Dock)' in l and w[3]=='Heard' and pos:
            s=seen(pos,segs,W,Dp);new=len(s-have)*C*C;have|=s;o.append('%.1f'%new)
    small=sum(float(x)<1.5 for x in o)
    tot[0]+=len(o);tot[1]+=small
    print(k[-6:],'LOST' if bat<.5 else 'home','flat %.0f m2 seen %.0f'%(free,len(have)*C*C),len(o),'small',small,' '.join(o))
print(tot)
