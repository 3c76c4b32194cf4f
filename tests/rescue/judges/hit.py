import sys,math,re,bisect,collections
C=collections.Counter();B=collections.Counter();F=collections.Counter()
sys.argv
exec(open('stalls.py').read().split("print('believed")[0])
# geometry
geo={}
for fn in sys.argv[1:]:
    n=0
    for l in open(fn):
        if l.startswith('Y '):
            k=l.split()[1]
            if (fn,k) in geo: continue
            walls=[]
            for m in re.finditer(r'Wall \{ from: Spot\(\[Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)\]\), to: Spot\(\[Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)\]\), thickness: ([\d.]+)',l):
                walls.append(tuple(map(float,m.groups())))
            fu=[]
            for m in re.finditer(r'Furniture \{ at: Spot\(\[Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)\]\), length: ([\d.]+), width: ([\d.]+), height: ([\d.]+), heading_degrees: ([-\d.]+)',l):
                fu.append(tuple(map(float,m.groups())))
            rm=re.search(r'width: ([\d.]+), depth: ([\d.]+)',l)
            n+=1
            geo[(fn,n)]=(walls,fu,float(rm.group(1)),float(rm.group(2)));geo[(fn,k)]=1
            legs=l
def seg(px,py,ax,ay,bx,by):
    dx,dy=bx-ax,by-ay;L=dx*dx+dy*dy
    t=max(0,min(1,((px-ax)*dx+(py-ay)*dy)/L)) if L else 0
    return ax+t*dx,ay+t*dy
def nearest(g,x,y):
    best=(9,None,0,0)
    for w in g[0]:
        qx,qy=seg(x,y,*w[:4]);d=math.hypot(x-qx,y-qy)-w[4]/2
        if d<best[0]: best=(d,'inner wall',qx,qy)
    for qx,qy,nm in((0,y,'outer wall'),(g[2],y,'outer wall'),(x,0,'outer wall'),(x,g[3],'outer wall')):
        d=math.hypot(x-qx,y-qy)
        if d<best[0]: best=(d,nm,qx,qy)
    for f in g[1]:
        c,s=math.cos(math.radians(f[5])),math.sin(math.radians(f[5]))
        dx,dy=x-f[0],y-f[1];u=c*dx+s*dy;v=-s*dx+c*dy
        uu=max(-f[2]/2,min(f[2]/2,u));vv=max(-f[3]/2,min(f[3]/2,v))
        d=math.hypot(u-uu,v-vv)
        if d<best[0]: best=(d,'furniture h%.1f'%f[4] if f[4]<.4 else 'furniture',f[0]+c*uu-s*vv,f[1]+s*uu+c*vv)
    return best
e=[x for x in eps if x[3]>=.1]
D=[]
for x in e:
    g=geo[(x[6],x[0])];p=x[8]
    b=nearest(g,p[0],p[1])
    a=math.degrees((math.atan2(b[3]-p[1],b[2]-p[0])-p[2]+math.pi)%(2*math.pi)-math.pi)
    nm=b[1] if b[0]<.25 else 'none near (%s)'%('person/rug/other')
    D.append(b[0])
    C[(nm,'held' if x[5]==1 else 'unnoticed')]+=1
    B[(nm,min(180,30*round(abs(a)/30)))]+=1
for k,v in sorted(C.items()): print(k,v)
for k,v in sorted(B.items()): print(k,v)
D.sort();print([round(D[int(len(D)*f)],2) for f in(.05,.1,.25,.5,.75,.9,.95)])
import random
random.seed(3)
print('----')
iw=[x for x in e if nearest(geo[(x[6],x[0])],x[8][0],x[8][1])[1]=='inner wall']
# reload logs for the chosen
for x in random.sample(iw,10):
    fn=x[6];k=None;order=[]
    for l in open(fn):
        if l[0]=='Y':
            q=l.split()[1]
            if q not in order: order.append(q)
    k=order[x[0]-1]
    T=[];PX=[];DD=[]
    for l in open(fn):
        a=l.split()
        if len(a)<3 or a[1]!=k: continue
        if a[0]=='P':T.append(float(a[2]));PX.append(tuple(map(float,a[3:6])))
        elif a[0]=='E' and a[3]=='Log' and a[4]=='D': DD.append((float(a[2]),a))
    b=nearest(geo[(fn,x[0])],x[8][0],x[8][1])
    print(fn[-7:-4],x[0],'stall t %.1f'%x[1],'contact',tuple(round(v,2) for v in b[2:]))
    last=0
    for t,a in DD:
        if x[1]-5<t<x[1]+.5 and t-last>.45:
            last=t;j=bisect.bisect(T,t)-1;p=PX[j]
            dx,dy=b[2]-p[0],b[3]-p[1];c,s=math.cos(p[2]),math.sin(p[2])
            print('   t%.1f contact ahead %.2f aside %.2f | room %s blind %s blocked %s heading %s'%(t,c*dx+s*dy,-s*dx+c*dy,a[-2],a[-1],a[9],a[7]))
